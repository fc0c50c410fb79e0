"""What experiments on an aeroplane in closed form find: its lift, surfaces and engines."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flighttune.studies.adoption import survey
from flighttune.vehicles.plants.jsbsim.bench import AirframeState

DEG, FT, G = math.pi / 180.0, 0.3048, 9.80665
DENSITY, AREA, MASS = 0.0023, 180.0, 70.0  # slug/ft^3, ft^2, slug


class Wing:
    """A bench whose lift is linear between two angles of attack, with a parabola of drag."""

    def __init__(self, slope=5.0, stall=12.0, low=-10.0, mass=MASS, at_zero=0.2, drag=0.03):
        self.slope, self.ends, self.at_zero, self.drag = slope, (low, stall), at_zero, drag
        self.numbers = {"metrics/Sw-sqft": AREA, "inertia/mass-slugs": mass}
        self.fdm = SimpleNamespace(reader=lambda name: lambda: self.numbers[name])

    def coefficients(self, alpha):
        lift = self.at_zero + self.slope * np.clip(alpha, *(x * DEG for x in self.ends))
        return lift, self.drag + 0.05 * lift**2

    def accelerations(self, state):
        (C_L, C_D), alpha = self.coefficients(state.alpha), state.alpha
        q = 0.5 * DENSITY * (state.V_a / FT) ** 2
        lift, drag = q * AREA * C_L, q * AREA * C_D
        self.numbers |= {
            "aero/qbar-psf": q,
            "forces/fbx-aero-lbs": lift * math.sin(alpha) - drag * math.cos(alpha),
            "forces/fbz-aero-lbs": -lift * math.cos(alpha) - drag * math.sin(alpha),
        }


@pytest.mark.parametrize(
    ("stall", "low", "found"), [(12.0, -10.0, (12.0, -10.0)), (40.0, -40.0, (18.0, -12.0))]
)
def test_lift_grows_to_the_stall_or_to_the_largest_angle_that_is_used(stall, low, found):
    wing = Wing(stall=stall, low=low)

    lift = survey._swept(wing, 60.0)

    assert (lift.stall / DEG, lift.negative_stall / DEG) == pytest.approx(found)
    largest, _ = wing.coefficients(found[0] * DEG)
    # weight = density / 2 V^2 S C_L
    slowest = math.sqrt(2.0 * MASS * G / FT / (DENSITY * AREA * largest)) * FT
    assert lift.V_s == pytest.approx(slowest, rel=1e-6)
    # at 4 deg lift carries the weight at the airspeed that its coefficient asks for
    C_L, C_D = wing.coefficients(4.0 * DEG)
    alpha, ratio = lift.at(lift.V_s * math.sqrt(largest / C_L))
    assert (alpha / DEG, ratio) == pytest.approx((4.0, C_D / C_L))


@pytest.mark.parametrize(
    ("wing", "words"),
    [
        (Wing(slope=-1.0), r"lift does not grow with alpha \(slope -1.00"),
        (Wing(slope=0.1, at_zero=0.0), "largest lift coefficient is 0.02"),
        (Wing(mass=1e5), "it would stall at"),
        (Wing(mass=0.01), "it would stall at"),
        (Wing(drag=math.nan), "no number at an angle of attack"),
    ],
)
def test_wings_that_carry_no_aeroplane_are_refused(wing, words):
    with pytest.raises(survey.Refusal, match=words):
        survey._swept(wing, 60.0)


COMMANDS = survey.COMMANDS


@pytest.mark.parametrize(
    ("effects", "usable"),
    [
        (COMMANDS, 1.0),
        (-3.0 * COMMANDS, 1.0),
        (np.minimum(COMMANDS, 0.5), 0.5),
        # slower, but more than a fifth as steep
        (np.minimum(COMMANDS, 0.5 + 0.21 * (COMMANDS - 0.5)), 1.0),
        (np.minimum(COMMANDS, 0.5 + 0.19 * (COMMANDS - 0.5)), 0.5),
        # a filter swallows the first steps
        (np.maximum(COMMANDS - 0.1, 0.0), 1.0),
        (np.clip(COMMANDS - 0.1, 0.0, 0.4), 0.5),
        (np.zeros(11), 0.0),
    ],
)
def test_commands_are_usable_until_their_effect_stops_growing(effects, usable):
    last = survey._last_usable(effects)
    assert (COMMANDS[last - 1] if last else 0.0) == usable


class Surfaces:
    """A bench on which a surface moves with its command, and accelerates the aeroplane."""

    def __init__(self, name, effect, position=None, **surface):
        table = SimpleNamespace(**{"replaces": (), "command": "", **surface})
        self.name, self.effect, self.position, self.command = name, effect, position, 0.0
        shown = survey.POSITIONS[name][-1] if position else ""
        self.fdm = SimpleNamespace(
            config=SimpleNamespace(surfaces=SimpleNamespace(**{name: table})),
            has=lambda x: x == shown,
            reader=lambda _: lambda: self.position(self.command),
        )

    def accelerations(self, state):
        self.command = getattr(state, self.name)
        return {survey.EFFECTS[self.name][0]: self.effect(self.command)}


LEVEL = AirframeState(V_a=30.0)


@pytest.mark.parametrize(("name", "sign"), [("aileron", 1.0), ("elevator", -1.0), ("rudder", -1.0)])
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_travel_is_what_the_position_shows_with_the_sense_of_its_effect(name, sign, turned):
    """Aileron rolls right, elevator and rudder turn the nose down and to the left: positive."""
    bench = Surfaces(name, lambda x: 2.0 + turned * sign * 40.0 * x, lambda x: 0.1 + 0.35 * x)

    effect, table = survey._moved(bench, LEVEL, name)

    assert effect == pytest.approx(turned * sign * 40.0)
    assert table["full_rad"] == pytest.approx([-turned * 0.35, turned * 0.35])
    assert table["travel_deg"] == pytest.approx([-20.05, 20.05])


def test_a_command_that_is_clipped_has_the_travel_that_is_used():
    """To the left the surface stops at half of the command, -0.175 rad."""

    def clipped(x):
        return max(x, -0.5)

    bench = Surfaces("aileron", lambda x: 40.0 * clipped(x), lambda x: 0.35 * clipped(x))

    effect, table = survey._moved(bench, LEVEL, "aileron")

    assert effect == pytest.approx(30.0)
    assert table["travel_deg"] == pytest.approx([-10.03, 20.05])
    assert table["full_rad"] == pytest.approx([-0.35, 0.35])


@pytest.mark.parametrize(
    ("surface", "full"),
    [
        ({}, 0.35),  # nothing shows the position
        ({"command": "fcs/elevator-pos-rad"}, 1.0),  # the command is the position
        ({"replaces": ("fcs/x-pos-rad",)}, 0.35),
    ],
)
def test_without_a_position_the_travel_is_the_usual_or_that_of_the_command(surface, full):
    bench = Surfaces("elevator", lambda x: -30.0 * x, **surface)

    effect, table = survey._moved(bench, LEVEL, "elevator")

    assert table["full_rad"] == pytest.approx([-full, full])
    assert effect == pytest.approx(-30.0 * (0.35 if surface.get("replaces") else 1.0))


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (lambda x: 1.0, "has no usable effect$"),
        (abs, "it changes p_dot in one sense only"),
        (lambda x: max(x, 0.0), "has no usable effect$"),
        (lambda x: math.nan, "is not finite"),
    ],
)
def test_surfaces_that_do_not_act_both_ways_are_refused(effect, words):
    with pytest.raises(survey.Refusal, match=words):
        survey._moved(Surfaces("aileron", effect), LEVEL, "aileron")


class Timed:
    """A bench on which a surface accelerates the aeroplane by an amount that changes over time."""

    def __init__(self, of_time, electric=False):
        self.t, self.of_time = 0.0, of_time
        surfaces = SimpleNamespace(aileron=SimpleNamespace(replaces=()))
        self.fdm = SimpleNamespace(
            hold=self.hold, electric=electric, reader=lambda _: lambda: of_time(self.t),
            config=SimpleNamespace(surfaces=surfaces),
        )  # fmt: skip

    def hold(self, seconds):
        self.t += seconds

    def accelerations(self, state):
        self.t = 0.0
        return {"p_dot": self.of_time(0.0) if state.aileron else 0.0}


@pytest.mark.parametrize(
    ("lag", "electric", "settles"),
    [
        # exp(-t / 4 s) falls below a thousandth after 27.5 s; at least 15 s
        (4.0, False, 28.0),
        (1.0, False, 15.0),
        # six times as long without thrust, at most 60 s
        (1.0, True, 42.0),
        (4.0, True, 60.0),
        (0.0, True, 0.0),
    ],
)
def test_engines_settle_when_their_thrust_is_within_a_thousandth(lag, electric, settles):
    def thrust(t):
        return 50.0 * (1.0 - math.exp(-t / lag)) if lag else 50.0

    bench = Timed(thrust, electric)
    both = [lambda: thrust(bench.t)] * 2

    assert survey._settling(bench, LEVEL, both) == settles


def drifting(t):
    """An effect that grows from 3 to 4 s by more than a twentieth."""
    return 4.0 + 0.21 * max(t - 3.0, 0.0)


@pytest.mark.parametrize(
    ("of_time", "words"),
    [
        (drifting, "its flight control drifts while the aileron command is held"),
        # until 3 s by more than a tenth
        (lambda t: 4.0 + 0.137 * min(t, 3.0), "its flight control keeps moving after the aileron"),
        (lambda t: 4.0, ""),
        (lambda t: 4.0 + 0.19 * max(t - 3.0, 0.0), ""),
        (lambda t: 4.0 + 0.13 * min(t, 3.0), ""),
    ],
)
def test_a_flight_control_keeps_its_effect_while_its_command_is_held(of_time, words):
    said = survey._drift(Timed(of_time), LEVEL, "aileron", 1.0)

    assert said.startswith(words)
    assert bool(said) == bool(words)


def test_a_drift_is_judged_by_a_tenth_of_the_full_effect_where_that_is_larger():
    assert survey._drift(Timed(drifting), LEVEL, "aileron", -60.0) == ""


class Engine(survey._Model):
    """An aeroplane of 1 lb whose thrust and drag are given, by throttle and by airspeed."""

    def __init__(self, thrust, drag, V_a=None):
        tables = {"engines": {}}
        super().__init__(tables=tables, folder=Path(), h=0.0, V_a=V_a, values={})
        self.thrust, self.drag = thrust, drag

    def load(self, **changed):
        full = changed["engines"].get("full", 1.0)
        state, numbers = LEVEL, {"inertia/mass-slugs": FT / G, survey.EXTERNAL: 0.0}

        def accelerations(new):
            nonlocal state
            state = new
            numbers["forces/fwx-aero-lbs"] = self.drag(state.V_a)

        fdm = SimpleNamespace(
            thrusts=[lambda: self.thrust(full * state.throttle)], electric=False, rate=200.0,
            reader=lambda name: lambda: numbers[name], start_engines=lambda: None,
            hold=lambda *_, **__: None,
        )  # fmt: skip
        return SimpleNamespace(fdm=fdm, accelerations=accelerations)


FLAT = survey.Lift(
    np.array([-0.2, 0.3]), np.array([-0.6, 1.0]), np.array([0.1, 0.1]), 0.3, -0.2, 20.0
)


@pytest.mark.parametrize(
    ("thrust", "drag", "V_a", "found"),
    [
        # the first airspeed with 0.08 of the weight to spare: 1.6, 1.8, 2.0, ... times 20 m/s
        (lambda x: 0.3 * x, lambda V: 0.1, None, (32.0, 0.2)),
        (lambda x: 0.3 * x, lambda V: 0.25 if V < 39.0 else 0.1, None, (40.0, 0.2)),
        (lambda x: 0.3 * x, lambda V: 0.2199, None, (32.0, 0.0801)),
        # or that with the most
        (lambda x: 0.12 * x, lambda V: 0.05 + 1e-4 * (V - 48.0) ** 2, None, (48.0, 0.07)),
        (lambda x: 0.12 * x, lambda V: 0.1, 27.0, (27.0, 0.02)),
        # fully open at a half
        (lambda x: 0.3 * min(2.0 * x, 1.0), lambda V: 0.1, None, (32.0, 0.2)),
        # twenty times the weight: a thirty-second of the lever, 0.625 of the weight
        (lambda x: 20.0 * x, lambda V: 0.1, None, (32.0, 0.525)),
    ],
)
def test_the_airspeed_is_the_first_with_thrust_to_spare_or_that_with_most(thrust, drag, V_a, found):
    model = Engine(thrust, drag, V_a)

    assert model._driven(model.tables, FLAT) == pytest.approx(found)
    assert model.tables["engines"]["settle_s"] == 0.0
    assert model.tables["engines"].get("full") == (1.0 / 32.0 if thrust(1.0) > 10.0 else None)


@pytest.mark.parametrize(
    ("thrust", "V_a", "words"),
    [
        (lambda x: 0.05 * x, None, "at most 0.50 of its drag at any airspeed"),
        (lambda x: 0.05 * x, 30.0, "thrust is 0.50 of its drag at 30 m/s"),
        (lambda x: 0.3, None, "does not follow the throttle"),
    ],
)
def test_engines_that_do_not_drive_an_aeroplane_are_refused(thrust, V_a, words):
    model = Engine(thrust, lambda V: 0.1, V_a)
    with pytest.raises(survey.Refusal, match=words):
        model._driven(model.tables, FLAT)
