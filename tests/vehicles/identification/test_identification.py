"""Identification of an inner loop: its excitation, responses and lags, and the file of a model."""

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import flighttune
from places import SHIPPED_AIRCRAFT
from published_aerosonde import accelerations
from scipy import signal
from scipy.optimize import fsolve

import flighttune as ft

DT, PERIOD = 0.01, 20.0
BAND = 0.3, 20.0  # rad/s
GOOD_FIT = 90.0
SAME_FIT, SAME_DELAY = 1e-3, 1e-4
"""Differences between two identifications of one aircraft, relative and in s."""
STEP = {"phi": (0.9, 1.0), "n_z": (0.8, 2.3)}
"""Unit and start of the 3-2-1-1 manoeuvre of each channel, s."""


@pytest.fixture(scope="module")
def made():
    """The Aerosonde, identified at two airspeeds and asked for one at which it cannot turn."""
    return ft.identify("aerosonde", V_a=[22.0, 15.2, 25.0])


def channels(made):
    return [(at, name, x) for at in made.conditions for name, x in at.channels.items()]


def by_scipy(lag, commanded):
    """The response of a lag to held commands, in steps of a tenth of a sample."""
    w, fine = lag.natural_frequency, 10
    den = [1.0, w] if lag.order == 1 else [1.0, 2.0 * lag.damping * w, w * w]
    num = [den[-1]]
    if lag.order == 3:
        den = np.polymul([lag.lag, 1.0], den)
    t = np.arange(len(commanded) * fine) * DT / fine
    held = np.floor((t - lag.delay) / DT + 1e-6).astype(int)
    late = (commanded - commanded[0])[np.clip(held, 0, None)]
    A, B, C, D, _ = signal.cont2discrete(signal.tf2ss(num, den), DT / fine)
    return signal.dlsim((A, B, C, D, DT / fine), late)[1][::fine, 0]


@pytest.mark.soak
def test_fits_are_the_responses_of_lags_and_explain_their_share_of_the_variance(made):
    for at, name, channel in channels(made):
        lag = channel.candidates[0].lag
        expected = channel.flown[0] + by_scipy(lag, channel.commanded)
        scale = np.ptp(channel.commanded)
        assert channel.fit == pytest.approx(expected, abs=0.02 * scale), (at.trim.V_a, name)
        left = np.mean((channel.flown - channel.fit) ** 2) / np.var(channel.flown)
        table = channel.table
        assert table.fit_percent == pytest.approx(100.0 * (1.0 - left), abs=1e-6)
        assert table.fit_percent > GOOD_FIT
        assert (table.lag, table.residual) == (lag, channel.candidates[0].residual)
        lower = [x.lag for x in channel.candidates if x.lag.order < 3]
        assert (table.simpler and table.simpler.lag) == (lower[0] if lower else None)
        if channel.frequency.other is not None:
            assert table.cross == pytest.approx(np.abs(channel.frequency.other).max())


@pytest.mark.slow
def test_lags_are_ranked_by_bayes_information_criterion_with_one_order_for_all_conditions(made):
    """Schwarz: N log(rss / N) + k log N, of 2 numbers a line and one parameter more for a delay."""
    for name in made.conditions[0].channels:
        total = dict.fromkeys((1, 2, 3), 0.0)
        for at in made.conditions:
            response, found = at.channels[name].frequency, at.channels[name].candidates
            assert sorted(x.lag.order for x in found) == [1, 2, 3]
            n = 2 * len(response.omega)
            for x in found:
                gap = np.abs(x.lag.response(response.omega) - response.own)
                assert x.residual == pytest.approx(math.sqrt(np.mean(gap**2)), rel=1e-6)
                each = max(np.sum(gap**2) / n, 1e-6)  # no finer than a distance of 0.001
                bic = n * math.log(each) + (x.lag.order + 1) * math.log(n)
                assert x.bic == pytest.approx(bic, rel=1e-6)
                total[x.lag.order] += x.bic
            assert [x.bic for x in found[1:]] == sorted(x.bic for x in found[1:])
        best = min(total, key=total.__getitem__)
        assert {at.channels[name].candidates[0].lag.order for at in made.conditions} == {best}


@pytest.mark.slow
def test_a_lag_is_the_nearest_of_its_order(made):
    """A lag a little beside it is farther from the response, whatever parameter is moved."""
    for _, name, channel in channels(made):
        omega, own = channel.frequency.omega, channel.frequency.own
        for x in channel.candidates:
            numbers = {"natural_frequency": x.lag.natural_frequency, "delay": x.lag.delay}
            numbers |= {"damping": x.lag.damping} if x.lag.order > 1 else {}
            numbers |= {"lag": x.lag.lag} if x.lag.order > 2 else {}
            for key, number in numbers.items():
                for factor in (0.97, 1.03):
                    moved = max(0.0, number * factor + (key == "delay") * 0.001 * (factor - 1.0))
                    beside = ft.loop.InnerLag(order=x.lag.order, **numbers | {key: moved})
                    gap = np.abs(beside.response(omega) - own)
                    assert math.sqrt(np.mean(gap**2)) > x.residual * (1.0 - 1e-3), (name, key)


@pytest.mark.slow
def test_excitations_have_the_lines_and_the_room_that_limits_leave(made):
    """Lines interleave from 0.3 to 20 rad/s; steps take 0.32 of the room."""
    limits = ft.loop.JSBSimPlant("aerosonde").config.limits
    room = {"phi": min(-limits.phi[0], limits.phi[1])}
    room["n_z"] = min(limits.n_z[1] - 1.0, 1.0 - limits.n_z[0])
    rates = {"phi": limits.phi_rate, "n_z": limits.n_z_rate}
    (at, *_) = made.conditions
    lines = {x: at.channels[x].frequency.omega * PERIOD / math.tau for x in ("phi", "n_z")}
    both = np.sort(np.concatenate([*lines.values()]))
    assert both == pytest.approx(np.round(both))
    assert (both[0], both[-1], len(both)) == (1.0, 64.0, len({*both.round().tolist()}))
    assert [x in lines["phi"] for x in both] == [i % 2 == 0 for i in range(len(both))]
    grid = np.geomspace(*BAND, 30) * PERIOD / math.tau
    assert np.abs(grid[:, None] - both).min(axis=1).max() <= 0.5
    thrust = at.channels["n_x"].frequency.omega * PERIOD / math.tau
    assert thrust == pytest.approx(np.unique(np.round(np.geomspace(*BAND, 15) * PERIOD / math.tau)))
    for name, (unit, start) in STEP.items():
        channel = at.channels[name]
        t = np.arange(len(channel.commanded)) * DT
        units = (t - start) / unit
        levels = np.select([units < x for x in (0, 3, 5, 6, 7)], [0, 1, -1, 1, -1], 0)
        size = 0.8 * 0.4 * room[name]
        reached = np.ones(len(t), dtype=bool)
        for k in np.flatnonzero(np.diff(levels, prepend=0)):
            reached[k : k + 1 + math.ceil(2.0 * size / (0.8 * rates[name]) / DT)] = False
        assert len(t) == 1200
        if name == "phi":  # about level flight in a bank the load factor is more than its change
            assert channel.commanded[reached] == pytest.approx(size * levels[reached], abs=1e-9)
            fastest = np.abs(np.diff(channel.commanded)).max() / DT
            assert fastest == pytest.approx(0.8 * rates[name], rel=1e-6)
        assert np.ptp(channel.commanded) == pytest.approx(2.0 * size, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["phi", "n_z"])
def test_a_response_is_that_to_a_sine_of_its_frequency(made, name):
    """Amplitude and phase of the aircraft itself, in the last of some periods."""
    channel = made.conditions[1].channels[name]
    k = int(np.argmin(np.abs(channel.frequency.omega - 5.0)))
    omega = channel.frequency.omega[k]
    plant = ft.loop.JSBSimPlant("aerosonde")
    plant.start(ft.loop.FlightCondition(V_a=25.0))
    t, flown = np.arange(round(5 * math.tau / omega / DT)) * DT, []
    for x in 0.05 * np.sin(omega * t):
        flown.append(plant.observe()[plant.signals.index(name)])
        plant.advance(*((x, 1.0) if name == "phi" else (0.0, 1.0 + x)), DT)
    last = slice(-round(math.tau / omega / DT), None)
    basis = np.column_stack([np.sin(omega * t), np.cos(omega * t), np.ones(len(t))])[last]
    (a, b, _), *_ = np.linalg.lstsq(basis, np.array(flown)[last], rcond=None)
    hold = np.sinc(omega * DT / math.tau) * np.exp(-0.5j * omega * DT)

    assert (a + 1j * b) / 0.05 == pytest.approx(complex(channel.frequency.own[k] * hold), abs=0.05)


@pytest.mark.slow
def test_an_identification_says_its_conditions_and_what_it_skips(made, tmp_path):
    (skipped,) = made.skipped
    assert "15.2 m/s" in skipped
    assert [x.V_a for x in made.identified.conditions] == [22.0, 25.0]
    assert made.place == "aerosonde at 22 m/s, 0 deg"
    files = made.save(tmp_path / "model.json")
    again = ft.loop.load_identified(tmp_path / "model.json")
    assert {x.suffix for x in files.values() if x} == {".svg", ".json"}
    for one, other in zip(
        again.conditions[0].lags, made.identified.conditions[0].lags, strict=True
    ):
        assert one.natural_frequency == pytest.approx(other.natural_frequency, rel=1e-5)


@pytest.mark.slow
def test_modes_are_those_of_the_published_equations(made):
    """Eigenvalues of the motion of body velocities, rates, roll and pitch about a trim."""

    def rates(x, controls):
        velocity, turn, (phi, theta) = x[:3], x[3:6], x[6:]
        V_a = math.hypot(*velocity)
        angles = math.atan2(velocity[2], velocity[0]), math.asin(velocity[1] / V_a)
        linear, angular = accelerations(V_a, *angles, turn, controls[:3], controls[3])
        up = [-math.sin(theta), *(math.cos(theta) * f(phi) for f in (math.sin, math.cos))]
        p, q, r = turn
        level = q * math.sin(phi) + r * math.cos(phi)
        attitude = p + math.tan(theta) * level, q * math.cos(phi) - r * math.sin(phi)
        linear = linear + 9.80665 * np.array(up) - np.cross(turn, velocity)
        return np.array([*linear, *angular, *attitude])

    def at(unknowns):
        alpha, elevator, throttle = unknowns
        u, w = 22.0 * math.cos(alpha), 22.0 * math.sin(alpha)
        return np.array([u, 0, w, 0, 0, 0, 0, alpha]), np.array([0, elevator, 0, throttle])

    trim = at(fsolve(lambda x: rates(*at(x))[[0, 2, 4]], (0.08, -0.1, 0.2)))
    step = 1e-5 * np.eye(8)
    A = [rates(trim[0] + x, trim[1]) - rates(trim[0] - x, trim[1]) for x in step]
    every = np.linalg.eigvals(np.array(A).T / 2e-5)

    found = {motion["name"]: motion for motion in made.modes}
    assert [*found] == ["short period", "phugoid", "dutch roll", "roll", "spiral"]
    for motion in made.modes:
        value = complex(*motion["eigenvalue_per_s"])
        assert np.abs(every - value).min() < 5e-3 * max(abs(value), 0.3), motion
        assert motion["natural_frequency_rad_s"] == pytest.approx(abs(value))
        assert motion["damping"] == pytest.approx(-value.real / abs(value))
    assert sum(1 + bool(m["eigenvalue_per_s"][1]) for m in made.modes) == 8
    fast = [found[name]["natural_frequency_rad_s"] for name in found]
    assert fast[0] > fast[1]
    assert fast[3] > fast[4]


@pytest.mark.soak
@pytest.mark.parametrize("name", ["paper", "level_turn"])
def test_aerosonde_is_explained_on_a_whole_scenario(name):
    (run,) = (r for r in ft.fly(name).runs if r.label == "jsbsim:aerosonde / paper")
    signals = run.signals
    lags = ft.loop.load_identified("aerosonde").conditions[0].lags
    for channel, lag in zip(("phi", "n_z"), lags, strict=True):
        command, flown = signals[f"{channel}_cmd"].to_numpy(), signals[channel].to_numpy()
        coarse = np.interp(np.arange(0.0, run.t[-1], DT), run.t, command)
        model = flown[0] + np.interp(run.t, np.arange(0.0, run.t[-1], DT), by_scipy(lag, coarse))
        assert 1.0 - np.mean((flown - model) ** 2) / np.var(flown) > GOOD_FIT / 100.0


@pytest.mark.counts
@pytest.mark.parametrize("aircraft", ["aerosonde", "c172p", "a4", "x8"])
def test_identifying_again_gives_the_shipped_model(aircraft):
    shipped = ft.loop.load_identified(aircraft).conditions[0]

    again = ft.identify(aircraft).identified.conditions[0]

    assert again.V_a == shipped.V_a
    for channel in ("phi", "n_z", "n_x"):
        one, other = shipped.channels[channel], again.channels[channel]
        assert one.lag.order == other.lag.order
        for value in ("natural_frequency", "damping", "lag"):
            assert getattr(one.lag, value) == pytest.approx(getattr(other.lag, value), rel=SAME_FIT)
        assert one.lag.delay == pytest.approx(other.lag.delay, abs=SAME_DELAY)


def test_the_file_holds_the_linear_model_with_names(tmp_path):
    path = tmp_path / "model.json"
    ft.loop.load_identified("aerosonde").save(path)

    table = json.loads(path.read_text())["conditions"][0]

    model, roll = table["model"], table["channels"]["phi"]
    A, B, C = (np.array(model[name]) for name in "ABC")
    s = 2.0j
    response = C @ np.linalg.solve(s * np.eye(len(A)) - A, B)
    w, z, h = roll["natural_frequency_rad_s"], roll["damping"], roll["delay_s"]
    pade = (1.0 - s * h / 2.0) / (1.0 + s * h / 2.0)
    lag = pade * w**2 / (s**2 + 2.0 * z * w * s + w**2) / (1.0 + s * roll["lag_s"])
    assert roll["order"] == 3
    assert model["inputs"] == ["phi_cmd", "n_z_cmd"]
    assert response[0, 0] == pytest.approx(-(9.80665 / 25.0) / s * lag, rel=1e-4)
    assert roll["bandwidth_rad_s"] == pytest.approx(13.1, abs=0.5)


FIRST, SECOND = "conditions.0", "conditions.1"
CONTRADICTIONS = f"""
{FIRST}.channels.phi.delay_s = -1.0 | channels.phi.delay_s` must
{SECOND}.model.A.0.0 = "<b>" | `conditions[1].model.A[0][0]` must be 0.0, as the lags
{FIRST}.channels.n_z.bandwidth_rad_s = 99.0 | channels.n_z.bandwidth_rad_s` must be
{FIRST}.channels.n_z.order = 4 | channels.n_z.order`
{FIRST}.channels.phi.more = 1 | more
{FIRST}.model.C.0.0 = 1.001 | model.C[0][0]` must be
""".strip().splitlines()


@pytest.mark.parametrize("row", CONTRADICTIONS)
def test_a_file_that_contradicts_itself_is_refused_by_key(row, tmp_path):
    change, _, words = row.partition(" | ")
    place, _, new = change.partition(" = ")
    *way, last = (int(x) if x.isdigit() else x for x in place.split("."))
    table = json.loads((SHIPPED_AIRCRAFT / "aerosonde/identified.json").read_text())
    inside = table
    for key in way:
        inside = inside[key]
    inside[last] = json.loads(new)
    path = tmp_path / "wrong.json"
    path.write_text(json.dumps(table))

    with pytest.raises(ft.ScenarioError, match=re.escape(words)) as said:
        ft.loop.load_identified(path)
    assert str(said.value).startswith(str(path))


def test_the_table_of_the_page_is_what_the_shipped_files_say():
    page = (Path(__file__).parents[3] / "docs/identification.md").read_text(encoding="utf-8")
    cell = r" *(\S+) *"
    told = re.findall(
        rf"^\|(?: (\w+), (\d+) m/s)? \| (roll|load factor) \|{cell}\|{cell}\|{cell}\|{cell}\|$",
        page, re.MULTILINE,
    )  # fmt: skip
    assert [row[0] for row in told] == ["aerosonde", "", "c172p", "", "a4", ""]
    shipped = []
    for name, V_a, *_ in told[::2]:
        found = json.loads((SHIPPED_AIRCRAFT / name / "identified.json").read_text())
        at = next(
            one for one in found["conditions"]
            if (one["V_a_mps"], one["gamma_deg"]) == (float(V_a), 0.0)
        )  # fmt: skip
        for channel in ("phi", "n_z"):
            lag = at["channels"][channel]
            digits = ("order", 0), ("bandwidth_rad_s", 1), ("delay_s", 3), ("fit_percent", 1)
            shipped.append([f"{lag[key]:.{places}f}" for key, places in digits])
    assert [list(row[3:]) for row in told] == shipped


def test_the_nearest_condition_counts_octaves_of_airspeed_and_degrees_of_climb():
    """Twice the airspeed is as far as 60 deg of climb, and it is on the side that is asked."""
    made = ft.loop.load_identified("aerosonde")

    def nearest(points, *asked):
        conditions = tuple(
            made.conditions[0].model_copy(update={"V_a": V_a, "gamma": gamma})
            for V_a, gamma in points
        )
        of = made.model_copy(update={"conditions": conditions})
        return [conditions.index(of.nearest(*x)) for x in asked]

    points = (20.0, 0.0), (40.0, 0.0), (20.0, 0.3)
    at = [(28.0, 0.0), (28.6, 0.0), (5.0, 0.14), (5.0, 0.16)]
    at += [(20.0 * 2.0**0.66, math.radians(60.0 * x)) for x in (-0.9, 0.9)]
    assert nearest(points, *at) == [0, 1, 0, 2, 1, 2]
    sides = [(25.0, x) for x in (-0.3, -0.02, 0.02, 0.3)]
    assert nearest(((25.0, -0.1), (25.0, 0.1)), *sides) == [0, 0, 1, 1]


@pytest.mark.slow
def test_numbers_that_leave_no_room_and_no_steady_flight_are_refused(tmp_path):
    (tmp_path / "aircraft").mkdir()
    text = (SHIPPED_AIRCRAFT / "aerosonde/aircraft.toml").read_text()
    for name, old, new, words in (
        (
            "room",
            "n_z            = [-2.1, 2.1]",
            "n_z = [-2.1, 1.0]",
            "must be finite and leave room",
        ),
        (
            "thrust",
            "n_x            = [-0.5, 1.0]",
            "n_x = [0.5, 1.0]",
            "`n_x` of [limits] must leave room",
        ),
    ):
        folder = tmp_path / name
        shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
        assert old in text
        (folder / "aircraft.toml").write_text(text.replace(old, new))

        err = flighttune("identify", folder, "--V-a", 25, "--out", tmp_path / "x.json", status=None)

        assert words in " ".join("".join(err).split())
