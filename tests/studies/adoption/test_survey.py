"""What experiments on an aeroplane in closed form find: its lift, surfaces and engines."""

import math
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

import flighttune as ft
from flighttune.studies.adoption import survey
from flighttune.vehicles.aircraft.aircraft import absolute_name
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
    """An aeroplane of 4 lb whose thrust and drag per weight are given, by throttle and by airspeed.

    Its second engine gives a quarter of the thrust.
    """

    def __init__(self, thrust, drag, V_a=None):
        tables = {"engines": {}}
        super().__init__(tables=tables, folder=Path(), h=0.0, V_a=V_a, values={})
        self.thrust, self.drag, self.airspeeds = thrust, drag, []

    def load(self, **changed):
        tables = self.tables | changed
        full, rate = tables["engines"].get("full", 1.0), tables.get("inner_loop_rate_hz", 200.0)
        state, numbers = LEVEL, {"inertia/mass-slugs": 4.0 * FT / G, survey.EXTERNAL: 0.0}
        running = [f"propulsion/engine[{i}]/set-running" for i in range(2)]
        numbers |= dict.fromkeys(running, 0.0)

        def accelerations(new):
            nonlocal state
            state = new
            self.airspeeds.append(state.V_a)
            numbers["forces/fwx-aero-lbs"] = 4.0 * self.drag(state.V_a)

        def hold(_, still=0.0, rate=rate):
            nonlocal steps
            assert still == 0.0  # which is for electric engines
            steps = rate

        def pushes(part):
            pushed = self.pushes(full * state.throttle, steps, tables)
            return part * pushed * numbers[running[0]]

        steps = rate
        fdm = SimpleNamespace(
            thrusts=[partial(pushes, 3.0), partial(pushes, 1.0)], electric=False, rate=rate,
            reader=lambda name: lambda: numbers[name], shows=lambda _: False, files=None, hold=hold,
            start_engines=lambda: numbers.update(dict.fromkeys(running, 1.0)),
        )  # fmt: skip
        return SimpleNamespace(fdm=fdm, accelerations=accelerations)

    def pushes(self, throttle, rate, tables):
        """Thrust in steps of this rate, under the settings of the tables."""
        return self.thrust(throttle)


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
    assert model.airspeeds[0] == pytest.approx(V_a or 32.0)
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
    model = Engine(thrust, lambda V: 0.1 if V < 35.0 else 0.2, V_a)
    with pytest.raises(survey.Refusal, match=words):
        model._driven(model.tables, FLAT)


class LightPropeller(Engine):
    """An engine that needs steps of `enough`, 1/s; in others it pushes as they let it."""

    enough = 400.0

    def pushes(self, throttle, rate, tables):
        return (0.3 if rate >= self.enough else 3e4 / rate) * throttle


@pytest.mark.parametrize(("enough", "rate"), [(300.0, 400.0), (700.0, 1000.0)])
def test_a_propeller_that_diverges_flies_in_the_first_finer_steps_that_it_needs(enough, rate):
    model = LightPropeller(None, lambda V: 0.1)
    model.enough = enough

    assert model._driven(model.tables, FLAT) == pytest.approx((32.0, 0.2))
    assert model.tables["inner_loop_rate_hz"] == rate
    assert "full" not in model.tables["engines"]


def test_a_propeller_that_diverges_in_all_steps_is_refused():
    model = LightPropeller(None, lambda V: 0.1)
    model.enough = 1500.0

    with pytest.raises(survey.Diverges, match="pushes with 150 times the weight"):
        model._driven(model.tables, FLAT)


def thrust_of(full, *, weight=10.0, rate=200.0, later=1.0, external=0.0, running=1.0):
    """Keys of engines for these thrusts at full throttle, `later` times them in half the steps."""
    numbers = {survey.EXTERNAL: external, "propulsion/engine[1]/n1": 30.0}
    numbers |= {f"propulsion/engine[{i}]/set-running": running for i in range(2)}
    held = []
    fdm = SimpleNamespace(
        reader=lambda name: lambda: numbers[name], rate=rate, shows=numbers.__contains__,
        thrusts=[lambda x=x: later * x for x in full], hold=lambda *_, rate: held.append(rate),
    )  # fmt: skip
    full = np.array(full)
    found = survey._thrust_of_another_kind(fdm, full, weight, lambda throttle: throttle * full)
    assert held in ([], [2.0 * rate])
    return found


def test_thrust_is_that_of_engines_of_a_force_or_of_a_part_of_the_lever():
    assert thrust_of([4.0, 5.0]) == thrust_of([4.0, 5.0], later=9.0) == {}
    assert thrust_of([0.0], external=3.0) == {"thrust": survey.EXTERNAL}
    # 160 over a weight of 10: a sixteenth pushes with the weight
    assert thrust_of([80.0, 80.0]) == {"full": 1.0 / 16.0}
    assert thrust_of([80.0, 81.0]) == {"full": 1.0 / 32.0}
    assert thrust_of([50.0, 50.0]) == {}  # ten times the weight is not too strong
    assert thrust_of([1e7, 1e7]) == {}  # no part of it is weak enough
    # in finer steps every thrust is checked
    assert thrust_of([4.0, 5.0], rate=400.0) == {}


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"full": [5.0, 0.0]}, "engine 2 of 2 does not push at full throttle: n1 30"),
        ({"full": [5.0, -1.0], "running": 0.0}, "engine 2 of 2 does not run"),
        ({"full": [0.0, 5.0], "external": 3.0}, "engine 1 of 2 does not push"),
        ({"full": [4.0, 5.0], "rate": 400.0, "later": 1.1}, "it pushes with 0.9 times the weight"),
        ({"full": [80.0, 80.0], "later": 0.9}, "16 times the weight, .* too small for 5 ms"),
        ({"full": [80.0, 80.0], "later": math.nan}, "diverges"),
    ],
)
def test_engines_that_push_like_no_aeroplanes_are_refused(asked, words):
    with pytest.raises(survey.Refusal, match=words):
        thrust_of(**asked)


class Levered(Engine):
    """An engine that pushes while `runs` holds of its tables, with properties that are 0."""

    texts = {"/controls/engines/engine/throttle"}, {"/controls/flight/rudder", "fcs/rudder"}

    def __init__(self, runs, *, thrust=0.3, declared=("/controls/magnetos",), values=()):
        super().__init__(lambda throttle: thrust * throttle, lambda V: 0.1)
        self.runs, self.values, self.lift = runs, dict(values), FLAT
        settings = {"fcs/advance-cmd-norm[0]": 1.0, "fcs/mixture-cmd-norm[0]": 1.0}
        declared = dict.fromkeys(declared, 0.0) | self.values
        self.tables |= {"declared": declared, "settings": settings, "linked": {}}

    def pushes(self, throttle, rate, tables):
        return self.thrust(throttle) if self.runs(tables) else 0.0


@pytest.fixture(autouse=True)
def flat(monkeypatch):
    """Sweeps of the lift of an engine, which has none, find `FLAT`."""
    swept = survey._swept
    monkeypatch.setattr(
        survey, "_swept", lambda bench, V: swept(bench, V) if isinstance(bench, Wing) else FLAT
    )


LINKED = {
    "/controls/engines/engine/throttle": "ft/throttle-norm",
    "/controls/flight/rudder": "-fcs/rudder-cmd-norm",
}


@pytest.mark.parametrize(
    ("runs", "how", "declared", "settings"),
    [
        (lambda tables: not tables["linked"], "", {"/controls/magnetos": 0.0}, {}),
        (lambda tables: tables["declared"]["/controls/magnetos"] == 3.0,
         "with FlightGear's levers linked and its switches on", {"/controls/magnetos": 3.0}, {}),
        (lambda tables: tables["settings"]["fcs/advance-cmd-norm[0]"] == 0.5,
         "with the propeller levers at a half", {"/controls/magnetos": 3.0},
         {"fcs/advance-cmd-norm[0]": 0.5}),
        (lambda tables: tables["settings"]["fcs/advance-cmd-norm[0]"] == 0.0,
         "with the propeller levers at 0", {"/controls/magnetos": 3.0},
         {"fcs/advance-cmd-norm[0]": 0.0}),
    ],
)  # fmt: skip
def test_levers_are_moved_until_every_engine_pushes(monkeypatch, runs, how, declared, settings):
    swept = []
    monkeypatch.setattr(survey, "_swept", lambda _, V: swept.append(V) or FLAT)
    model = Levered(runs)
    before = dict(model.tables["settings"])

    model.drive()

    assert (model.speed, model.spare) == pytest.approx((32.0, 0.2))
    assert bool(swept) == bool(how)  # levers may change the weight
    assert swept == pytest.approx([32.0] * len(swept))
    assert model.notes == ([f"its engines drive it {how}"] if how else [])
    assert model.tables["linked"] == (LINKED if how else {})
    assert model.tables["declared"] == declared
    assert model.tables["settings"] == before | settings


def test_a_lever_that_is_set_stays_and_a_dead_engine_is_refused(monkeypatch):
    monkeypatch.setattr(survey.model_files, "has_engine", lambda *_: False)
    runs = Levered(lambda tables: tables["declared"]["/controls/magnetos"] == 1.0,
                   values={"/controls/magnetos": 1.0})  # fmt: skip
    dead = Levered(lambda tables: False)

    runs.drive()

    assert runs.tables["declared"] == {"/controls/magnetos": 1.0}
    with pytest.raises(survey.Refusal, match="engine 1 of 2 does not push"):
        dead.drive()


def test_engines_that_are_too_weak_stay_off_and_a_rocket_glides(monkeypatch):
    """At 1.6 times the stalling speed the drag of the glide is a tenth of the lift."""
    monkeypatch.setattr(survey.model_files, "has_engine", lambda *_: True)
    weak, rocket = Levered(lambda tables: True, thrust=0.05), Levered(lambda tables: False)

    weak.drive()
    rocket.drive()

    for model, words in ((weak, "0.50 of its drag at any airspeed: its engines stay off"),
                         (rocket, "a rocket has no thrust while its fuel is frozen")):  # fmt: skip
        (note,) = model.notes
        assert words in note
        assert model.tables["engines"]["count"] == 0
        assert (model.speed, model.spare) == pytest.approx((32.0, -FLAT.at(32.0)[1]))
        assert model.tables["linked"] == {}


def test_a_propeller_that_diverges_ends_the_search_for_levers():
    model = Levered(lambda tables: True)
    model.pushes = lambda throttle, rate, tables: 3e4 / rate * throttle

    with pytest.raises(survey.Diverges):
        model.drive()


class Noted(Levered):
    """Engines under their notes: keys of `[engines]`, what JSBSim shows, and propellers."""

    def __init__(self, engines, shown=(), *propellers, rate=None):
        super().__init__(None)
        self.tables["engines"] = {"count": 1, **engines}
        self.tables |= {"inner_loop_rate_hz": rate} if rate else {}
        self.shown, self.roots, self.speed = dict(shown), [*map(fromstring, propellers)], 32.0

    roots = ()

    def load(self, **changed):
        numbers = {"inertia/iyy-slugs_ft2": 4.0, "inertia/izz-slugs_ft2": 9.0, **self.shown}
        fdm = SimpleNamespace(
            shows=self.shown.__contains__, reader=lambda name: lambda: numbers[name], electric=False
        )
        return SimpleNamespace(fdm=fdm, accelerations=lambda _: None)


PROPELLER = '<propeller><ixx> {} </ixx><diameter unit="IN"> 16 </diameter></propeller>'


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (({},), []),
        (({"count": 0, "full": 0.125},), ["without an engine, about its steady glide"]),
        (({}, {survey.FUEL: 0.0}), ["its tanks are empty"]),
        (({}, {survey.FUEL: 1.0}), []),
        (({"full": 0.125},), ["full throttle is 0.125 of its lever"]),
        (({"thrust": survey.EXTERNAL},), ["an external force pushes it (forces/fbx-external-lbs)"]),
        (({}, {}, "<propeller><diameter> 70 </diameter></propeller>"),
         ["the diameter of its propeller has no unit: it is inches"]),
        (({}, {}, "<engine><diameter> 70 </diameter></engine>"), []),
        # 0.2 x 2400 rpm over the 6 slug ft^2 across: 8.38 rad/s
        (({}, {survey.PROPELLER_RPM: -2400.0}, PROPELLER.format(0.2), PROPELLER.format(0.1)),
         ["nutates at 8.38 rad/s: an inertia of 0.2 slug ft2 at -2.4e+03 rpm"]),
        (({}, {survey.PROPELLER_RPM: 2200.0}, PROPELLER.format(0.2)), []),
        (({}, {}, PROPELLER.format(9.0)), []),
    ],
)  # fmt: skip
def test_what_is_unusual_in_engines_is_noted(asked, words):
    model = Noted(*asked)

    model.note_engines()

    assert len(model.notes) == len(words)
    assert all(x in note for x, note in zip(words, model.notes, strict=True))


def test_all_that_is_unusual_in_engines_is_noted_at_once():
    model = Noted({"full": 0.5, "thrust": survey.EXTERNAL}, {survey.FUEL: 0.0}, rate=400.0)

    model.note_engines()

    assert len(model.notes) == 4
    assert model.notes[2].endswith("its inner loop runs at 400 Hz")


class Geared(Levered):
    """A throttle whose position follows properties, which are 0, and the usual command."""

    roots = ()

    def __init__(self, position, *, read=(), defined=(), declared=(), values=()):
        super().__init__(None, declared=declared, values=values)
        self.position, self.defined, self.speed = position, {*defined}, 32.0
        self.texts = set(), {survey.THROTTLE_POSITION, *read}

    def load(self, **changed):
        tables, throttle = self.tables | changed, 0.0
        numbers = dict.fromkeys((*self.texts[1], *self.defined), 0.0)
        numbers |= tables["declared"] | tables["settings"]

        def accelerations(state):
            nonlocal throttle
            throttle = state.throttle
            return dict.fromkeys(("u_dot", "v_dot", "w_dot"), 0.0)

        def reader(name):
            if name.startswith("accelerations/"):
                return lambda: 0.0
            if name == survey.THROTTLE_POSITION:
                return lambda: self.position(lambda x: numbers[x], throttle)
            return lambda: numbers[name]

        fdm = SimpleNamespace(
            shows=lambda _: True, has=numbers.__contains__, reader=reader, evaluate=lambda: None,
            writer=lambda name: partial(numbers.__setitem__, name), hold=lambda _: None,
            config=SimpleNamespace(surfaces=SimpleNamespace(named=dict)),
        )  # fmt: skip
        return SimpleNamespace(fdm=fdm, accelerations=accelerations)


@pytest.mark.parametrize(
    ("position", "asked", "found"),
    [
        # the usual command moves it, by more than a half
        (lambda of, throttle: 0.3 + 0.51 * throttle, {"read": ["fcs/lever"]}, {}),
        # levers do, of which one is read beside others that do not
        (lambda of, throttle: 0.4 + 0.55 * of("fcs/lever") + 0.6 * of("a/lever")
         + 0.3 * of("x/y") + of("velocities/x"),
         {"read": ["fcs/lever", "a/lever", "x/y", "velocities/x", "/other/lever"]},
         {"command": "a/lever", "linked": {"fcs/lever": "ft/throttle-norm"}}),
        # the usual command does where a switch is on, or a factor is not 0
        (lambda of, throttle: 0.3 + 0.7 * throttle * of("systems/on"),
         {"defined": ["systems/off", "systems/on"]}, {"settings": {"systems/on": 1.0}}),
        (lambda of, throttle: throttle * of("/battery"), {"declared": ["/a", "/battery"]},
         {"declared": {"/battery": 1.0}}),
        # not if that is stated
        (lambda of, throttle: throttle * of("/battery"), {"values": {"/battery": 0.0}}, {}),
        (lambda of, throttle: throttle * of("systems/on"),
         {"defined": ["systems/on"], "values": {"systems/on": 0.0}}, {}),
        (lambda of, throttle: 0.2, {"read": ["fcs/lever"], "declared": ["/battery"]}, {}),
    ],
)  # fmt: skip
def test_a_throttle_is_moved_by_its_command_by_levers_or_behind_a_switch(position, asked, found):
    model = Geared(position, **asked)
    before = {name: dict(model.tables[name]) for name in ("declared", "settings", "linked")}

    model.find_throttle()

    command = {"command": found["command"]} if "command" in found else {}
    assert model.tables["engines"] == command
    for name, table in before.items():
        assert model.tables[name] == table | found.get(name, {})
    names = (
        {"a/lever, fcs/lever"} if command else {*found.get("settings", found.get("declared", ()))}
    )
    assert len(model.notes) == len(names)
    assert all(name in note for name, note in zip(names, model.notes, strict=True))


def test_a_throttle_whose_command_is_named_is_not_looked_for():
    model = Geared(lambda of, throttle: of("fcs/lever"), read=["fcs/lever"])
    model.tables["engines"]["command"] = "fcs/other"

    model.find_throttle()

    assert model.tables["engines"] == {"command": "fcs/other"}
    assert not model.notes


class Read(Levered):
    """An aeroplane whose aerodynamics read properties, with its fuel, mass and inertias."""

    roots = ()

    def __init__(self, aerodynamics=(), systems=(), **more):
        super().__init__(None, **more)
        self.texts, self.speed = ({*aerodynamics}, {*systems}), 30.0
        self.numbers, self.levels = dict.fromkeys((*aerodynamics, *systems), 0.0), []

    def answers(self, state, numbers):
        """Angular accelerations, and properties that follow the state and others."""
        return {}, {}

    def load(self, **changed):
        tables = self.tables | changed
        numbers = self.numbers | tables["settings"]
        numbers |= {name.removeprefix("ft/"): x for name, x in tables["declared"].items()}
        state = LEVEL

        def accelerations(new):
            nonlocal state
            state = new
            self.levels.append(state)
            rates, changed = self.answers(state, numbers)
            numbers.update(changed)
            return rates

        def hold(seconds):
            numbers.update(self.later(state))

        def writer(name):
            return partial(numbers.__setitem__, name.removeprefix("ft/"))

        fdm = SimpleNamespace(
            shows=numbers.__contains__, has=numbers.__contains__, writer=writer, hold=hold,
            reader=lambda name: lambda: numbers[name], declared_writer=writer,
        )  # fmt: skip
        return SimpleNamespace(fdm=fdm, accelerations=accelerations)

    def later(self, state):
        """Properties that flight control has moved after a while."""
        return {}


class Steered(Read):
    """Moments about three axes per property, of an airframe with inertias of 1, 10 and 20."""

    INERTIAS = (1.0, 10.0, 20.0)

    def __init__(self, moments, *more, computed=()):
        super().__init__([*moments, *more])
        self.moments = moments
        self.numbers |= dict.fromkeys(moments, 0.2)
        self.numbers |= {
            f"inertia/i{axis}-slugs_ft2": x
            for axis, x in zip(("xx", "yy", "zz"), self.INERTIAS, strict=True)
        }
        functions = "".join(f'<function name="{name}"/>' for name in computed)
        self.roots = [fromstring(f"<fdm_config>{functions}</fdm_config>")]

    def answers(self, state, numbers):
        sums = np.sum([numbers[name] * np.array(x) for name, x in self.moments.items()], axis=0)
        rates = ("p_dot", "q_dot", "r_dot")
        return dict(zip(rates, 3.0 + sums / np.array(self.INERTIAS), strict=True)), {}


def test_a_surface_is_what_has_at_least_half_of_the_largest_moment_in_its_sense():
    """Positive are to roll right, and to turn the nose down and to the left."""
    per_degree = math.pi / 180.0
    model = Steered(
        {
            "fcs/a": (4.0, 0.0, 3.0),  # rolls
            "fcs/b": (-2.1, 0.0, -4.5),  # rolls less than it yaws
            "fcs/c": (1.9, 0.1, 0.0),  # rolls too little
            "fcs/d-deg": (0.0, -50.0 * per_degree, 0.0),  # pitches, by the degree
            "fcs/e": (0.0, 26.0, 0.0),
            "fcs/f": (0.0, 24.0, 0.0),
            "fcs/g": (1.0, 25.0, -5.0),  # pitches and yaws
            "fcs/h": (0.0, 0.0, -2.4),
            "fcs/i": (1.0, 0.0, 0.0),
            "aero/alpha": (90.0, 90.0, 90.0),  # JSBSim's own
            "sum": (90.0, 90.0, 90.0),  # which is computed
        },
        "fcs/nothing",
        computed=("sum",),
    )

    found, said = model._movers()

    assert found == {
        "aileron": ["fcs/a", "-fcs/b"],
        "elevator": ["fcs/d-deg", "-fcs/e", "-fcs/g"],
        "rudder": ["fcs/g"],
    }
    assert said == ""


def test_controls_that_nothing_moves_are_named_with_what_was_tried():
    rolls = Steered({"fcs/a": (4.0, 0.0, 0.0)}, *(f"fcs/x{n}" for n in range(8)))
    few = Steered({"fcs/a": (4.0, 0.0, 0.0)}, "fcs/x")
    none = Steered({"aero/alpha": (9.0, 9.0, 9.0)})
    # half of 1e-6 rad/s^2 at most
    weak = Steered({"fcs/a": (0.0, 1e-5, 0.0)})

    (found, said), (_, of_two), (nothing, of_none) = (x._movers() for x in (rolls, few, none))
    assert weak._movers()[0] == nothing

    assert found == {"aileron": ["fcs/a"], "elevator": [], "rudder": []}
    eight = ", ".join(["fcs/a", *(f"fcs/x{n}" for n in range(7))])
    assert f"({eight}, ...) nothing pitches it" in said
    assert "(fcs/a, fcs/x) nothing pitches it" in of_two
    assert nothing == {"aileron": [], "elevator": [], "rudder": []}
    assert of_none == ", and its aerodynamics read nothing that rolls or pitches it"


class FlyByWire(Read):
    """Flight control that moves positions with the motion, one of them late."""

    def answers(self, state, numbers):
        moved = {"fcs/slat": 0.3 + state.alpha, "fcs/canard": 0.1 * state.elevator}
        return {}, moved | {"fcs/late": 0.0, "fcs/still": 0.0099 * state.q, "fcs/stab": state.alpha}

    def later(self, state):
        return {"fcs/late": 0.5 + state.q, "fcs/slat": 0.4 + state.alpha}


def test_what_flight_control_moves_beside_the_surfaces_is_held_as_in_level_flight():
    """In level flight at 30 m/s a lift of (20 / 30)^2 of the largest asks for 0.0389 rad."""
    read = [f"fcs/{x}" for x in ("slat", "canard", "late", "still", "stab", "fixed")]
    model = FlyByWire([*read, "aero/alpha"])
    model.texts[0].add("fcs/unseen")

    held = model._held({"elevator": {"replaces": ["-fcs/stab"]}})

    alpha = np.interp(4.0 / 9.0, FLAT.lift, FLAT.alpha)
    assert held == {
        "ft/fcs/slat": pytest.approx(0.4 + alpha),
        "ft/fcs/canard": 0.0,
        "ft/fcs/late": 0.5,
    }


@pytest.mark.parametrize(
    ("read", "replaced", "said"),
    [
        ({"fcs/left-aileron-pos-rad", "fcs/x/aileron-pos-norm", "fcs/mag-elevator-pos-rad",
          "fcs/stabilator-pos-deg", "fcs/rudder-deflection-rad", "fcs/rudder-cmd-norm"},
         {"aileron": ["fcs/left-aileron-pos-rad", "fcs/x/aileron-pos-norm"],
          "elevator": ["fcs/mag-elevator-pos-rad", "fcs/stabilator-pos-deg"],
          "rudder": ["fcs/rudder-deflection-rad"]}, ""),
        # the magnitude of a deflection moves nothing: what moves is measured
        ({"fcs/aileron-pos-rad", "fcs/mag-elevator-pos-rad", "fcs/rolls", "fcs/pitches"},
         {"aileron": ["fcs/rolls"], "elevator": ["fcs/pitches"]}, ""),
        ({"fcs/aileron-pos-rad", "fcs/elevator-pos-rad", "rudder"},
         {"aileron": ["fcs/aileron-pos-rad"], "elevator": ["fcs/elevator-pos-rad"]}, ""),
        # a rudder that is read is wanted
        ({"fcs/aileron-pos-rad", "fcs/elevator-pos-rad", "fcs/rudder-cmd-norm"}, {}, ""),
        ({"fcs/aileron-pos-rad", "fcs/rolls"}, {}, "nothing pitches it"),
    ],
)  # fmt: skip
def test_positions_past_the_flight_control_are_those_that_the_aerodynamics_read(
    read, replaced, said
):
    moments = {"fcs/rolls": (4.0, 0.0, 0.0), "fcs/pitches": (0.0, -4.0, 0.0)}
    model = Steered({name: moments.get(name, (0.0,) * 3) for name in read})
    model.tables["surfaces"] = {name: {"max": 1} for name in ("aileron", "elevator", "rudder")}

    found, note = model._past_flight_control()

    assert found == {name: {"max": 1, "replaces": x} for name, x in replaced.items()}
    assert note.endswith(said)
    assert bool(note) == bool(said)


FLAP, BRAKE = "fcs/flap-pos-norm", "fcs/speedbrake-pos-norm"
IN_BY = {FLAP: "/flap-in", BRAKE: "/brake-in", survey.GEAR: "/gear-in"}


class Extended(Read):
    """Flaps, brake and gear that are out by shares, each until a declared property is 1."""

    def __init__(self, out, *, retracts="1", declared=(), values=()):
        super().__init__((FLAP,), (BRAKE, survey.GEAR), declared=declared, values=values)
        self.out = out
        self.numbers |= dict.fromkeys(out, 0.0)
        wheels = "".join(f"<retractable> {x} </retractable>" for x in (retracts, 0))
        self.roots = [fromstring(f"<fdm_config>{wheels}</fdm_config>")]

    def answers(self, state, numbers):
        return {}, {
            name: share * (numbers.get(IN_BY.get(name)) != 1.0) for name, share in self.out.items()
        }


def test_what_is_out_is_put_in_by_the_first_property_that_does_it():
    zeros = ("/other", "/gear-in", "/flap-in", "/brake-in")
    model = Extended({FLAP: 0.5, BRAKE: -0.4, survey.GEAR: 1.0}, declared=zeros)
    # not if that is stated
    stated = Extended({FLAP: 0.5}, declared=zeros, values={"/flap-in": 0.0})
    within = Extended({FLAP: 0.009, "fcs/spoiler-pos-norm": 1.0})  # the latter is not read
    fixed = Extended({survey.GEAR: 1.0}, retracts="0")

    for each in (model, stated, within, fixed):
        each.put_in()

    put_in = dict.fromkeys(("/gear-in", "/flap-in", "/brake-in"), 1.0)
    assert model.tables["declared"] == {"/other": 0.0, **put_in}
    assert model.notes == [
        f"{name} is in by {IN_BY[name]} = 1" for name in (survey.GEAR, FLAP, BRAKE)
    ]
    assert set(stated.tables["declared"].values()) == {0.0}
    assert stated.notes == [f"{FLAP} is 0.5: it is out"]
    assert within.notes == fixed.notes == []


BODY = dict(zip(survey.BODY.values(), (70.0, 180.0, 900.0, 1300.0, 2000.0), strict=True))


class Loaded(Read):
    """A model with two engines, whose levers are 0, and a body."""

    LEVERS = (
        *("propulsion/fuel_freeze", "gear/gear-cmd-norm", "fcs/flap-cmd-norm"),
        *("fcs/mixture-cmd-norm[0]", "fcs/mixture-cmd-norm[1]", "fcs/mixture-cmd-norm[2]"),
        *("fcs/advance-cmd-norm[1]", "fcs/trim"),
    )

    def __init__(self, body=(), *, declared=(), values=(), surfaces=(), linked=()):
        super().__init__(("fcs/a-cmd",), ("/fcs/slash", "fcs/b-cmd"), declared=declared)
        self.values, self.tables["settings"] = dict(values), {}
        self.tables["engines"]["count"] = 2
        self.tables |= {"surfaces": dict(surfaces), "linked": dict(linked)}
        self.numbers |= dict.fromkeys(self.LEVERS, 0.0) | BODY | dict(body)


def test_levers_of_the_engines_are_full_and_others_are_in():
    model = Loaded(
        declared=("/x",), values={"/x": 3.0, "fcs/trim": 0.1}, linked={"fcs/b-cmd": "-fcs/a-cmd"},
        surfaces={"aileron": {"command": "fcs/a-cmd"}, "elevator": {}},
    )  # fmt: skip

    model.set_levers()

    assert model.tables["settings"] == {
        "propulsion/fuel_freeze": 1.0, "gear/gear-cmd-norm": 0.0, "fcs/flap-cmd-norm": 0.0,
        "fcs/mixture-cmd-norm[0]": 1.0, "fcs/mixture-cmd-norm[1]": 1.0,
        "fcs/advance-cmd-norm[1]": 1.0, "fcs/trim": 0.1,
    }  # fmt: skip
    assert model.tables["declared"] == {"/x": 3.0}
    assert model.notes == []


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"values": {"fcs/none": 1.0}}, "--set fcs/none: the model must have .* neither.$"),
        ({"values": {"fcs/slash": 1.0}}, "neither; it reads /fcs/slash, with a slash.$"),
        ({"values": {"/fcs/slash": 1.0}}, "--set /fcs/slash: the model must have"),
        ({"surfaces": {"rudder": {"command": "fcs/c"}}}, "--rudder: the model must read fcs/c,"),
        ({"surfaces": {"rudder": {"command": "fcs/a-cmd"}}, "linked": {"fcs/d": "-fcs/a-cmd"}},
         "--rudder: the model must read fcs/d,"),
        ({"body": {"metrics/Sw-sqft": 0.0}}, "its wing area must be above zero, got 0 "),
        ({"body": {"inertia/iyy-slugs_ft2": math.inf}}, "its inertia yy must be above zero"),
    ],
)  # fmt: skip
def test_what_is_set_is_there_and_a_body_has_mass(asked, words):
    with pytest.raises((ft.InputError, survey.Refusal), match=words):
        Loaded(**asked).set_levers()


def test_a_moment_of_inertia_above_the_sum_of_the_others_is_no_bodys():
    """A hundredth of the sum of all three is allowed: the mark is 2242 slug ft^2."""
    small = {"metrics/Sw-sqft": 0.5}
    models = [Loaded(small | {"inertia/izz-slugs_ft2": izz}) for izz in (2240.0, 2250.0)]

    for model in models:
        model.set_levers()

    assert models[0].notes == []
    (said,) = models[1].notes
    assert "inertia zz exceeds the sum of the others" in said


class Referring(Read):
    """A model that refers to properties, one after the other, that are not there."""

    late = ()  # those to which it refers in flight

    def __init__(self, *refers, stated=(), values=(), says="Property {} does not exist"):
        super().__init__(declared=(), values=values)
        self.refers, self.says, self.tables["declared"] = refers, says, {}
        paths = {absolute_name(name): x for name, x in dict(stated).items()}
        self.stated = survey.Stated(files=("x-set.xml",), values=paths)
        names = {*refers, *self.stated.values}
        texts = "".join(f"<input> -{name} </input>" for name in names)
        self.roots = [fromstring(f"<fdm_config><system>{texts}</system></fdm_config>")]

    def load(self, **changed):
        self.lack(self.refers)
        return super().load(**changed)

    def later(self, state):
        self.lack(self.late)
        return {}

    def lack(self, names):
        for name in names:
            if name not in self.tables["declared"]:
                raise ft.loop.PlantError(self.says.format(name))


def test_what_a_model_refers_to_is_declared_with_what_is_stated_or_0():
    model = Referring(
        "a/b", "/c/d", "e/gear-cmd", "/position/altitude-ft", "g/h", "/velocities/mach",
        stated={"a/b": 0.7, "e/gear-cmd": 1.0, "g/h": 9.0, "not/yet": 2.0},
        values={"g/h": 5.0, "/velocities/mach": 0.4},
    )  # fmt: skip
    model.late = ("in/flight",)

    model.declare()

    assert model.tables["declared"] == {
        "/velocities/mach": 0.4, "a/b": 0.7, "/c/d": 0.0, "e/gear-cmd": 0.0,
        "/position/altitude-ft": 0.0, "g/h": 0.0, "in/flight": 0.0, "not/yet": 2.0,
    }  # fmt: skip
    # what FlightGear shows of the flight follows it, unless it is set
    assert model.tables["linked"] == {"/position/altitude-ft": "position/h-sl-ft"}
    assert [(x.V_a, round(x.alpha / DEG)) for x in model.levels[1:]] == [
        *((60.0, 0), (15.0, 8), (150.0, 0), (300.0, 2))
    ]


def test_a_fault_that_no_declaration_cures_is_told(monkeypatch):
    for faulty in (Referring("a/b", says="No such file"), Referring("ft/x")):
        with pytest.raises(ft.loop.PlantError, match=r"No such file|ft/x"):
            faulty.declare()
    monkeypatch.setattr(survey, "MAX_DECLARED", 3)
    names = ["a/b", "c/d"]
    Referring(*names).declare()
    with pytest.raises(survey.Refusal, match=r"more than 3 properties .* such as a/b, c/d, e/f$"):
        Referring(*names, "e/f").declare()
    with pytest.raises(survey.Refusal, match="more than 3"):
        Referring(*names, values={"/v": 1.0}).declare()
    for values in ({"a b": 1.0}, {"a/b": math.inf}):
        with pytest.raises(ft.InputError, match="--set must be NAME=VALUE"):
            Referring(values=values).declare()


def test_values_that_are_stated_and_zeros_that_are_not_are_noted():
    refers = ("a/b", "c/d", "e/f", "x/gear-cmd", *(f"/z/y{n}" for n in range(11)))
    model = Referring(*refers, stated={"a/b": 0.7, "c/d": 0.0, "x/gear-cmd": 1.0})
    model.declare()
    model.tables["declared"]["/on"] = 1.0
    off = [
        survey.SwitchedOff("CDo", ("e/f",), "drag", 0.42),
        survey.SwitchedOff("CLo", ("/z/y0", "/z/y1"), "lift", 0.05),
        survey.SwitchedOff("CD2", ("e/f",), "drag", 0.1),
    ]

    model.note_values(off)

    stated, lever, of_drag, of_lift, others = model.notes
    assert stated == "x-set.xml states a/b = 0.7 and 0 for c/d and x/gear-cmd"
    assert lever == "x/gear-cmd is 0 as in flight, 1 is stated"
    assert of_drag == (
        "e/f of another simulator is 0 and switches off CDo (with 1 up to 42 % of the drag) and "
        "CD2 (with 1 up to 10 % of the drag): --set e/f=VALUE states it"
    )
    assert of_lift == (
        "/z/y0 and /z/y1 of another simulator are 0 and switches off CLo (with 1 up to 5 % of the "
        "lift): --set /z/y0=VALUE states them"
    )
    eight = ", ".join(f"/z/y{n}" for n in range(2, 10))
    assert others == (
        f"properties of another simulator are 0: {eight} and 1 more, all in `[declared]`"
    )


def test_zeros_that_the_aerodynamics_read_end_a_refusal():
    one, two = (Referring(*names) for names in (("a/b", "c/d"), ("a/b", "c/d", "e/f")))
    one.texts, two.texts = ({"a/b", "x/y"}, {"c/d"}), ({"a/b", "e/f"}, set())
    two.stated = survey.Stated(
        files=("x-set.xml", "y-set.xml"),
        differ=frozenset({"/fdm/jsbsim/a/b"}),
        unread=(("/fdm/jsbsim/e", "z.xml is a pipe"), ("/fdm/jsbsim/q", "no")),
    )
    assert one.zeros_in_words == ""
    for model in (one, two):
        model.declare()

    assert "aerodynamics read a/b, which is" in one.zeros_in_words
    assert one.zeros_in_words.endswith("--set a/b=VALUE states it")
    assert "aerodynamics read a/b and e/f, which are" in two.zeros_in_words
    assert two.zeros_in_words.endswith(
        "(z.xml is a pipe; x-set.xml and y-set.xml state several values of a/b)"
    )


def test_texts_of_a_model_are_those_of_its_aerodynamics_and_all_others():
    model = survey._Model(tables={}, folder=Path(), h=0.0, V_a=None, values={})
    main = """<fdm_config> root <aerodynamics><function><p> -aero/x//y </p><t> table </t></function>
        </aerodynamics><flight_control><channel><input> fcs/b </input></channel></flight_control>
        <system><property> c/./d </property></system></fdm_config>"""
    files = (
        main,
        "<aerodynamics><axis> e/f </axis></aerodynamics>",
        "<autopilot><property>g/h</property><o><property>i/j</property></o></autopilot>",
    )
    model.roots = [fromstring(text) for text in files]

    inside, outside = model.texts

    assert inside - {""} == {"aero/x/y", "table", "e/f"}
    assert outside - {""} == {"root", "fcs/b", "c/d", "g/h", "i/j"}
    assert model.defined - {""} == {"c/d", "g/h"}
