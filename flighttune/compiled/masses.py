# SPDX-License-Identifier: LGPL-2.1-or-later
"""Mass, centre of gravity and inertia by the numbers of a flight: FGMassBalance."""

from collections.abc import Callable, Mapping, Sequence
from itertools import count
from xml.etree.ElementTree import Element

from flighttune.compiled.air_data import SLUG_TO_LB, body_arm
from flighttune.compiled.properties import Unsupported, named
from flighttune.compiled.rigid_body import INERTIA, INVERSE_INERTIA, inverse_inertia
from flighttune.compiled.vectors import ZERO, Matrix, Vector, add, over, scale

_SLUG = 1.0 / SLUG_TO_LB
_FORMS = ("form", "ixx", "iyy", "izz", "ixy", "ixz", "iyz")

# Weight and place of a load, by the text of its number, and its axes
_POINT = "inertia/pointmass-weight-lbs{}", "inertia/pointmass-location-{1}-inches{0}", "XYZ"
_TANK = "propulsion/tank{}/contents-lbs", "propulsion/tank{}/{}-position", "xyz"

# Where the numbers of a flight stand for the mass
EMPTY = "emptywt"


def is_open(root: Element) -> bool:
    """Whether flights have masses of their own."""
    return "{{" in (root.findtext(f"mass_balance/{EMPTY}") or "")


def mass_properties(
    root: Element, numbers: Mapping[str, float], value: Callable[[str], float | None]
) -> dict[str, float]:
    """Mass (slug), centre of gravity (in) and inertia (slug ft^2) of an aircraft with open masses.

    `numbers` are those of the flight, `value` gives JSBSim's properties of its loads.
    """
    balance = root.find("mass_balance")
    assert balance is not None  # it is open
    for point in balance.iter("pointmass"):
        if any(point.find(form) is not None for form in _FORMS):
            raise Unsupported("a point mass with a form")
        if "{{" in (point.findtext("weight") or ""):
            raise Unsupported("a point mass of each flight")

    def number(path: str) -> float:
        return numbers[(balance.findtext(path) or "").strip()]

    empty, base = number(EMPTY), [number(f"location/{axis}") for axis in "xyz"]
    xx, yy, zz, xy, xz, yz = (number(f"i{name}") for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    points, tanks = (_loads(value, *names) for names in (_POINT, _TANK))
    if any(value(f"propulsion/tank[{i}]/local-ixx-slug_ft2") for i in range(len(tanks))):
        raise Unsupported("a tank with a form")
    weight = empty + sum(w for w, _ in tanks) + sum(w for w, _ in points)
    moment = add(add(scale(empty, base), _moment(points)), _moment(tanks))
    cg = over(moment, weight)
    J: Matrix = [[xx, xy, -xz], [xy, yy, yz], [-xz, yz, zz]]
    J = _added(J, _of_point(empty, base, cg))
    for loads in (points, tanks):
        of_loads: Matrix = [[0.0] * 3 for _ in range(3)]
        for w, place in loads:
            of_loads = _added(of_loads, _of_point(w, place, cg))
        J = _added(J, of_loads)
    cells = [x for matrix in (J, inverse_inertia(J)) for row in matrix for x in row]
    found = {"inertia/mass-slugs": _SLUG * weight, "inertia/weight-lbs": weight}
    found |= dict(zip(named("inertia/cg-{}-in"), cg, strict=True))
    return found | dict(zip((*INERTIA, *INVERSE_INERTIA), cells, strict=True))


def _loads(
    value: Callable[[str], float | None], weight: str, place: str, axes: str
) -> list[tuple[float, Vector]]:
    """Weights (lbf) and places (in) of all point masses or tanks, by names with their number."""
    found: list[tuple[float, Vector]] = []
    for i in count():
        number = f"[{i}]" if i else ""
        if (w := value(weight.format(number))) is None:
            return found
        found.append((w, [value(place.format(number, axis)) for axis in axes]))
    return found


def _moment(loads: Sequence[tuple[float, Vector]]) -> Vector:
    moment: Vector = ZERO
    for weight, place in loads:
        moment = add(moment, scale(weight, place))
    return moment


def _of_point(weight: float, place: Vector, cg: Vector) -> Matrix:
    """Inertia of a point about the centre of gravity, in body axes."""
    v = body_arm(place, cg)
    sv = scale(_SLUG * weight, v)
    xx, yy, zz = (a * b for a, b in zip(sv, v, strict=True))
    xy, xz, yz = -sv[0] * v[1], -sv[0] * v[2], -sv[1] * v[2]
    return [[yy + zz, xy, xz], [xy, xx + zz, yz], [xz, yz, xx + yy]]


def _added(a: Matrix, b: Matrix) -> Matrix:
    return [list(add(x, y)) for x, y in zip(a, b, strict=True)]
