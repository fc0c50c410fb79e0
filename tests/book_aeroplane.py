"""The Aerosonde with parts that move its surfaces, and what is found of it in closed form."""

import math

import numpy as np
import pytest

W, RHO, S = 11.0 * 9.80665, 1.11164, 0.55  # N, kg/m3 at 1000 m, m2
V_S = math.sqrt(2.0 * W / (RHO * S * 1.48))  # it stalls at 14 deg, where lift grows less


def glide(V_a):
    """Lift over drag of the book: C_D = 0.043 + C_L^2 / (pi 0.9 AR)."""
    C_L = W / (0.5 * RHO * V_a**2 * S)
    return C_L / (0.043 + 0.0232 * C_L**2)


def system(*components):
    return f"<system name='own'><channel name='own'>{''.join(components)}</channel></system>"


def more(*parts):
    """The change of a model that adds parts at its end."""
    return "</fdm_config>", f"{''.join(parts)}</fdm_config>"


def gain(name, inside="<gain>0.35</gain>", source=None, output=None, kind="pure_gain"):
    source = source or f"fcs/{name}-cmd-norm"
    output = output or f"fcs/{name}-pos-rad".replace("aileron", "left-aileron")
    return (
        f"<{kind} name='a/{name}'><input>{source}</input>{inside}<output>{output}</output></{kind}>"
    )


ELEVATOR, RUDDER = gain("elevator"), gain("rudder")


def calculated(name, function, output):
    return f"<fcs_function name='a/{name}'><function>{function}</function>{output}</fcs_function>"


def flown_by(*aileron, parts=(), tops=()):
    """The change of a model that gives it surfaces which move by 0.35 rad, and other parts."""
    return [more(*tops, system(*(aileron or [gain("aileron")]), ELEVATOR, RUDDER, *parts))]


# Of the table of lift, what is between -14 and 30 deg in steps of 1 deg, and drag over the same.
ALPHA = np.arange(-14.0, 31.0)
C_L = np.interp(
    ALPHA, [-16, -14, -12, 12, 14, 16, 20, 30],
    [-1.02, -1.01, -0.94496, 1.40496, 1.48, 1.5, 1.35, 1.05],
)  # fmt: skip
SEPARATED = np.interp(ALPHA, [-16, -12, 12, 16, 20, 30], [0.03, 0.0, 0.0, 0.03, 0.12, 0.5])
C_D = 0.043 + 0.0232 * C_L**2 + SEPARATED
FULL = {"travel_deg": [-20.05, 20.05], "full_rad": [-0.35, 0.35]}
POSITIONS = {x: f"fcs/{x}-pos-rad" for x in ("elevator", "rudder")}
POSITIONS = {"aileron": "fcs/left-aileron-pos-rad"} | POSITIONS
SETTINGS = {"propulsion/fuel_freeze": 1.0, "gear/gear-cmd-norm": 0.0, "fcs/flap-cmd-norm": 0.0}
SETTINGS |= {"fcs/speedbrake-cmd-norm": 0.0}
LEVERS = {"fcs/mixture-cmd-norm[0]": 1.0, "fcs/advance-cmd-norm[0]": 1.0}


def found_of(V_a=1.6 * V_S, thrust=120.0):
    """What is found of the book's aeroplane at an airspeed, with a thrust in N."""
    return {
        "lift.V_s": V_S, "lift.stall": math.radians(14.0), "lift.negative_stall": -math.pi / 15.0,
        "lift.lift": (C_L / 1.48).tolist(), "lift.drag": (C_D / 1.48).tolist(),
        "V_a": V_a, "glide_ratio": glide(V_a), "spare_thrust": thrust / W - 1.0 / glide(V_a),
        "largest_drag": ("aero/force/drag", 1.0), "surfaces": dict.fromkeys(POSITIONS, FULL),
        "engines": {"count": 1, "settle_s": 0.0}, "settings": SETTINGS | LEVERS,
        "declared": {}, "linked": {}, "switched_off": (),
    }  # fmt: skip


CLOSED_FORM = 1e-4
"""Relative: angles of travel have two digits, drag over angles is linear between degrees."""


def value(found, name):
    """A value of a survey by its name, or by its key in the tables."""
    first, _, rest = name.partition(".")
    got = getattr(found, first) if hasattr(found, first) else found.tables.get(first)
    return getattr(got, rest) if rest else got


def differs(got, wanted):
    match wanted:
        case None:
            return False
        case dict():
            return got.keys() != wanted.keys() or any(differs(got[x], wanted[x]) for x in wanted)
        case list() | tuple():
            return len(got) != len(wanted) or any(map(differs, got, wanted))
        case float():
            return got != pytest.approx(wanted, rel=CLOSED_FORM, abs=1e-6)
    return got != wanted
