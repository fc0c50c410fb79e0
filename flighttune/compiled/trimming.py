# SPDX-License-Identifier: LGPL-2.1-or-later
"""JSBSim's evaluation of an initial state, in which no time passes, as a trim asks for it.

An initial state has an attitude, a velocity over ground, an airspeed and its direction. Whatever is
written to it changes the others by rounding.
"""

from flighttune.compiled.ir import function_ir, module
from flighttune.compiled.motion import AT_START
from flighttune.compiled.properties import (
    INERTIAL_RATES,
    INERTIAL_VELOCITY,
    POSITION,
    Properties,
    named,
)
from flighttune.compiled.rigid_body import (
    ACCELERATION_1,
    INERTIAL_ACCELERATION,
    QUATERNION,
    VELOCITY_1,
    VELOCITY_2,
)
from flighttune.compiled.run import Model, evaluate
from flighttune.compiled.step import Names
from flighttune.compiled.trace import Graph, Number, different, equal, select, sqrt
from flighttune.compiled.turbulence import WIND
from flighttune.compiled.vectors import (
    Matrix,
    Vector,
    add,
    euler_angles,
    magnitude,
    matrix_of,
    product,
    quaternion_by,
    quaternion_of,
    quaternion_product,
    sub,
    times,
    transposed,
)

# Attitude; velocity to north, east and down (ft/s); airspeed; rotation from wind to body
ATTITUDE, OVER_GROUND, AIRSPEED = named("_ic-q{}", "0123"), named("_ic-v{}", "ned"), "_ic-V"
WIND_TO_BODY = [f"_ic-wind{i}{j}" for i in range(3) for j in range(3)]
STATE = (*ATTITUDE, *OVER_GROUND, AIRSPEED, *WIND_TO_BODY)

# Distance from the centre of the Earth, ft; body rates, rad/s
RADIUS, RATES = "_ic-radius", named("_ic-{}", "pqr")

# What is written: a velocity along an axis of the body, an angle or a velocity over ground; the
# number of its axis, and its value.
WRITE = KIND, AXIS, VALUE = "_ic-kind", "_ic-axis", "_ic-value"
BODY, ANGLE, LOCAL = 0.0, 1.0, 2.0

ANGLES = named("ic/{}-rad", ("phi", "theta", "psi-true"))

# An initial state that nothing was written to
AT_REST = dict.fromkeys((*STATE, *RATES), 0.0) | {ATTITUDE[0]: 1.0}
AT_REST |= {f"_ic-wind{i}{i}": 1.0 for i in range(3)}


def evaluation(model: Model) -> Properties:
    """An evaluation; its values are all that it computes, also what JSBSim does not show."""
    now = Properties(Graph(), model.dt)
    now.trimming, now.elapsed = True, 0.0
    _set_motion(now)
    evaluate(now, model)
    # The motion begins with the acceleration of the first of two evaluations.
    before = now.vector(INERTIAL_ACCELERATION)
    evaluate(now, model)
    now.put(ACCELERATION_1, before)
    for names in (VELOCITY_1, VELOCITY_2):
        now.put(names, now.vector(INERTIAL_VELOCITY))
    return now


def writing() -> tuple[Names, str]:
    """Names and IR of a write to an initial state, a step each; the properties are `ANGLES`."""
    graph = Graph()
    now = Properties(graph, 0.0)
    axis, value = now[AXIS], now[VALUE]
    q, over_ground = now.vector(ATTITUDE), now.vector(OVER_GROUND)
    to_body = matrix_of(q)
    to_local = transposed(to_body)
    through = _through_air(now, to_local)
    body, wind = times(to_body, over_ground), sub(through, over_ground)

    def written(old: Vector) -> Vector:
        return [select(equal(axis, float(i)), value, x) for i, x in enumerate(old)]

    turned = quaternion_by(*written(euler_angles(to_body)))
    new_to_local = transposed(matrix_of(turned))
    velocities = (times(to_local, written(body)), times(new_to_local, body), written(over_ground))

    def chosen(of_body: Number, of_angle: Number, of_local: Number) -> Number:
        kind = now[KIND]
        return select(equal(kind, BODY), of_body, select(equal(kind, ANGLE), of_angle, of_local))

    over_ground = [chosen(*xs) for xs in zip(*velocities, strict=True)]
    q = [chosen(old, new, old) for old, new in zip(q, turned, strict=True)]
    through = add(over_ground, wind)
    V = magnitude(through)
    to_body = matrix_of(q)
    directions = _wind_to_body(times(to_body, through), V)
    now.put(ATTITUDE, q)
    now.put(OVER_GROUND, over_ground)
    now[AIRSPEED] = V
    now.put(WIND_TO_BODY, [x for row in directions for x in row])
    names = Names(STATE, (), WRITE, (), tuple(ANGLES))
    arrays = {"s": STATE, "u": WRITE}
    places = {name: (array, i) for array, of in arrays.items() for i, name in enumerate(of)}
    new, shown = [now.now[name] for name in STATE], list(euler_angles(to_body))
    return names, module(function_ir("step", graph, places, new, [], shown, len(WRITE)))


def _through_air(now: Properties, to_local: Matrix) -> Vector:
    """Velocity through the air to north, east and down."""
    cells = now.vector(WIND_TO_BODY)
    wind_to_body = [cells[0:3], cells[3:6], cells[6:9]]
    return times(product(to_local, wind_to_body), [now[AIRSPEED], 0.0, 0.0])


def _wind_to_body(through: Vector, V: Number) -> Matrix:
    u, v, w = through
    plane = sqrt(u * u + w * w)
    moving, along = different(V, 0.0), different(plane, 0.0)
    c_a, s_a = select(along, u / plane, 1.0), select(along, w / plane, 0.0)
    c_b, s_b = select(moving, plane / V, 1.0), select(moving, v / V, 0.0)
    return [[c_a * c_b, -c_a * s_b, -s_a], [s_b, c_b, 0.0], [s_a * c_b, -s_a * s_b, c_a]]


def _set_motion(now: Properties) -> None:
    """Motion and wind of the initial state."""
    local = now.vector(ATTITUDE)
    to_body = matrix_of(local)
    now.put(POSITION, [now[RADIUS], 0.0, 0.0])
    q = quaternion_product(quaternion_of(AT_START), local)
    now.put(QUATERNION, q)
    velocity = times(to_body, now.vector(OVER_GROUND))
    now.put(INERTIAL_VELOCITY, times(transposed(matrix_of(q)), velocity))
    # The planet does not turn: its part is zeros, which decide the sign of a zero in the sum.
    of_planet = times(matrix_of(q), [0.0, 0.0, 0.0])
    now.put(INERTIAL_RATES, add(now.vector(RATES), of_planet))
    now.put(WIND, sub(_through_air(now, transposed(to_body)), now.vector(OVER_GROUND)))
