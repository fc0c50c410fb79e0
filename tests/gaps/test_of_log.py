"""A log of our own flight with a known change against the aircraft without it."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from airframes import changed_aerosonde
from commands import answer, flighttune
from log_files import heavy_cessna, sampled, write_csv
from made_up import made_up_run
from scipy.integrate import solve_ivp
from scipy.signal import lsim, lti
from scipy.stats import t as student

import flighttune as ft
from flighttune.gaps import of_log
from flighttune.logs.identify import interval_of
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.plants.point_mass import PointMassPlant

G = 9.80665

MASS, LATE, WIND = 1.2, 0.15, (3.0, 3.0 * math.sqrt(3.0))
"""Of the flight: mass over the model's; s; m/s to the north and to the east."""
HELD = 0.01
"""Half a sample of the controller, by which a command that is held comes later, s."""
MASS_ERROR, LAG_ERROR, WIND_ERROR = 0.05, 0.01, 0.1
"""Allowed with noise, dropouts and late stamps at 25 Hz."""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Flight of a heavier Cessna in wind, its commands stamped early."""
    t, signals = sampled(heavy_cessna(165.0))
    early = {name: np.interp(t + LATE, t, signals[name]) for name in ("phi_cmd", "n_z_cmd")}
    return write_csv(tmp_path_factory.mktemp("gap") / "flight.csv", t, signals | early)


@pytest.mark.soak
def test_mass_lag_and_wind_of_a_flight_come_back(log):
    told = answer("gap", log, "--aircraft", "c172p", "--out", log.parent / "gap", cwd=log.parent)

    factors = {row["factor"]: row for row in told["factors"]}
    assert factors["mass"]["value"] == pytest.approx(MASS, abs=MASS_ERROR)
    for name in ("phi_late", "n_z_late"):
        assert factors[name]["value"] == pytest.approx(LATE + HELD, abs=LAG_ERROR)
    for name, true in zip(("wind_north", "wind_east"), WIND, strict=True):
        assert factors[name]["value"] == pytest.approx(true, abs=WIND_ERROR)
    assert all(row["low"] < row["value"] < row["high"] for row in factors.values())
    assert told["explained_percent"] > 99.0
    causes = {row["cause"]: row for row in told["causes"]}
    assert max(causes, key=lambda name: causes[name]["alone_percent"]) == "wind"
    law, *_, aircraft, explained = told["differences"]
    assert (law["flown"], aircraft["flown"]) == ("kinematic", "c172p")
    assert explained["phi"] < 0.2 * aircraft["phi"] < aircraft["phi"] < law["phi"]
    assert (log.parent / "gap" / "gap.svg").stat().st_size > 10_000


def integrated_flight(folder, *, late=(0.0, 0.0), wind=(0.0, 0.0), V_a=25.0):
    """Log of the equations of a point mass behind the lags of the Aerosonde, by SciPy.

    The commands reach roll and load factor so much later than the lags have it, s.
    """
    lags = ft.loop.load_identified("aerosonde").nearest(V_a, 0.0).lags
    t = np.arange(0.0, 56.0, 0.02)

    def behind(i, command):
        lag, w = lags[i], lags[i].natural_frequency
        poles = [1.0, w] if lag.order == 1 else [1.0, 2.0 * lag.damping * w, w * w]
        over = np.polymul(poles, [lag.lag, 1.0] if lag.order == 3 else [1.0])
        seen = np.interp(t - lag.delay - late[i], t, command)
        return command[0] + lsim(lti([poles[-1]], over), seen - command[0], t)[1]

    def flown(phi, n_z):
        def rates(now, x):
            bank, lift = np.interp(now, t, phi), np.interp(now, t, n_z)
            turn = lift * math.sin(bank) / math.cos(x[1])
            return G / V_a * turn, G / V_a * (lift * math.cos(bank) - math.cos(x[1]))

        return solve_ivp(rates, (0.0, t[-1]), (0.4, 0.0), t_eval=t, rtol=1e-7, atol=1e-8).y

    roll = 0.45 * np.sin(0.25 * t) + 0.15 * np.sin(1.7 * t + 1.0)
    pulls = 0.1 * np.sin(0.9 * t) + 0.05 * np.sin(2.9 * t)
    phi, lift = behind(0, roll), 1.0 / np.cos(roll) + pulls
    for _ in range(2):  # its path stays level but for the last term
        rate = behind(1, lift) * np.cos(phi) - 1.0 - pulls
        lift = lift - np.polynomial.Polynomial.fit(t, rate, 9)(t) / np.cos(phi)
    commands, n_z = (roll, lift), behind(1, lift)
    chi, gamma = flown(phi, n_z)
    north = V_a * np.cos(gamma) * np.cos(chi) + wind[0]
    east = V_a * np.cos(gamma) * np.sin(chi) + wind[1]
    climb, V_g = V_a * np.sin(gamma), np.hypot(north, east)
    signals = {
        "chi": np.unwrap(np.arctan2(east, north)), "gamma": np.arctan2(climb, V_g), "V_g": V_g,
        "V_a": np.full_like(t, V_a), "phi": phi, "n_z": n_z, "phi_cmd": commands[0],
        "n_z_cmd": commands[1], "h": 1000.0 + np.cumsum(climb) * 0.02,
    }  # fmt: skip
    file = folder / "flight.csv"
    pd.DataFrame({"t_s": t, **signals}).to_csv(file, index=False)
    return file


@pytest.mark.slow
def test_a_flight_of_the_equations_of_the_model_differs_by_wind_and_delays_alone(tmp_path):
    wind, late = (1.5, -2.0), (0.08, -0.03)
    model = load_aircraft("aerosonde").folder / "identified.json"

    gap = ft.gap(integrated_flight(tmp_path, late=late, wind=wind), aircraft=str(model))

    found = {name: value for name, (value, _, _) in gap.factors.items()}
    assert [found[name] for name in ("phi_late", "n_z_late")] == pytest.approx(late, abs=LAG_ERROR)
    north_east = [found[name] for name in ("wind_north", "wind_east")]
    assert north_east == pytest.approx(wind, abs=WIND_ERROR)
    assert all(low < found[name] < high for name, (_, low, high) in gap.factors.items())
    assert gap.explained > 0.998
    assert len(gap.notes) == 1  # an identified model has no airframe to change
    assert gap.tracking == ()
    # The shares of two causes that have little to do with each other add up to the whole.
    (lag, without_lag), (air, without_air) = gap.causes["lag"], gap.causes["wind"]
    assert lag + air == pytest.approx(1.0, abs=0.02)
    assert (without_lag, without_air) == pytest.approx((lag, air), abs=0.02)
    assert 0.05 < lag < 0.2
    # What adds up from the start of a stretch has no mean, the others have theirs.
    law, *_, model, explained = gap.answer().tables[0].records
    squares = [
        sum((row[name] / scale) ** 2 for name, scale in of_log.SCALES.items() if name in row)
        for row in (model, explained)
    ]
    assert gap.explained == pytest.approx(1.0 - squares[1] / squares[0])
    assert explained["phi"] < 0.02 * model["phi"]
    assert explained["chi"] < 0.04 * model["chi"] < model["chi"] < law["chi"]
    assert explained["tail"] < 0.02 * model["tail"]
    assert model["tail"] == pytest.approx(math.hypot(*wind) / 2.0**0.5, rel=0.2)


@pytest.mark.counts
def test_the_mass_comes_back_without_load_factor_commands(log):
    table = pd.read_csv(log).drop(columns="n_z_cmd")
    table.to_csv(log.with_stem("without"), index=False)

    gap = ft.gap(log.with_stem("without"), aircraft="c172p")

    assert gap.factors["mass"][0] == pytest.approx(MASS, abs=2.0 * MASS_ERROR)
    assert "The log has no load-factor commands: its load factor is flown" in gap.notes[0]


def of_two_parameters(second):
    """Ends of the intervals of two parameters that fit four stretches of noise, shape (2, 2)."""
    random = np.random.default_rng(3)
    jacobian = random.standard_normal((4, 50, 2))
    jacobian[..., 1] = second(jacobian)
    normal = np.einsum("smi,smj->sij", jacobian, jacobian)
    slope = np.einsum("smi,sm->si", jacobian, random.standard_normal((4, 50)))
    return interval_of(np.ones(2), normal, slope, np.zeros(2))


def test_a_factor_without_an_effect_of_its_own_has_no_interval():
    apart, alike, without, nothing = (
        np.isfinite(of_two_parameters(second)).all(axis=0).tolist()
        for second in (
            lambda jacobian: jacobian[..., 1],
            lambda jacobian: 2.0 * jacobian[..., 0],
            lambda jacobian: 0.0,
            lambda jacobian: np.multiply(jacobian, 0.0, out=jacobian)[..., 1],
        )
    )

    assert apart == [True, True]
    assert alike == nothing == [False, False]
    assert without == [True, False]


@pytest.mark.parametrize(
    ("name", "fitted", "says"),
    [
        ("mass", (1.2, 1.1, 1.3), ""),
        ("mass", (1.0, 0.9, 1.1), ""),
        ("mass", (1.0, 0.81, 1.19), ""),
        ("mass", (1.0, 0.79, 1.21), "its interval at 95 %, 0.79 to 1.2, holds 1 and is too wide"),
        ("mass", (1.6, 1.1, 2.1), ""),
        ("mass", (0.7, 0.1, 1.3), "its interval at 95 %, 0.3 to 1.3, holds 1 and is too wide"),
        ("phi_late", (1.98, 1.9, 2.1), "the best fit is at an end of its range, -1 to 2 s"),
        ("damping", (1.0, -math.inf, math.inf), "a change of it has the same effect"),
    ],
)
def test_what_a_log_cannot_tell_of_a_factor_has_its_reason(name, fitted, says):
    said = of_log.FACTORS[name].unidentifiable(*fitted)

    assert said.startswith(says)
    assert bool(said) == bool(says)


@pytest.mark.slow
def test_a_log_that_an_aircraft_cannot_fly_is_one_line(log):
    said = flighttune("gap", log, "--aircraft", "aerosonde", status=2, cwd=log.parent)[1]

    assert "aerosonde: must fly 3 stretches of the log at least, got 0" in said
    assert "V_a" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "`aircraft` must be given with a log"),
        (("--aircraft", "c172p", "--gains", "paper"), "`aircraft` must be given with a log"),
        (("--aircraft", "nothing"), "`aircraft` must be one of"),
    ],
)
def test_a_log_and_its_aircraft_go_together(log, arguments, says):
    said = flighttune("gap", log, *arguments, status=2, cwd=log.parent)[1]

    assert says in " ".join(said.split())


@pytest.mark.soak
def test_a_log_without_roll_commands_is_one_line(log):
    run = ft.load_log(log)
    bare = ft.Run(
        signals=run.signals.drop(columns="phi_cmd"),
        status="completed",
        reason="",
        provenance=run.provenance,
    )

    with pytest.raises(ft.InputError, match="must have phi_cmd"):
        ft.gap(bare, aircraft="c172p")


def test_stretches_of_a_log_begin_after_its_gaps_and_none_overlap():
    t = np.arange(1501) * 0.1
    columns = dict.fromkeys(("chi", "gamma", "n_z"), 0.0) | {"V_g": 20.0, "phi": 0.0}
    columns["phi_cmd"] = np.radians(6.0) * np.sign(np.sin(t))
    columns["phi"] = np.where(np.isin(t.round(1), (3.0, 5.0, 7.0, 60.0, 61.5)), np.nan, 0.0)

    times, _ = of_log._stretches(made_up_run(columns, t), 0.1)

    # 17 s each, from the first sample after the gaps until 7 s and until 61.5 s
    starts = times[:, 0]
    expected = [7.1, 24.2, 41.3, 61.6, 78.7, 95.8, 112.9, 130.0]
    assert starts == pytest.approx(expected, abs=0.01)
    assert not any(((row[0] <= 60.0) & (60.0 <= row[-1])) for row in times)
    assert (np.diff(starts) >= 17.0).all()


def test_signals_in_the_air_become_those_over_ground_in_a_wind_from_ahead():
    """Level north at 20 m/s over ground: a wind of 5 m/s from the north, and a climb of 10 deg."""
    flights = of_log._Flights.__new__(of_log._Flights)
    flights.logged = {"chi": np.zeros((1, 3)), "V_g": np.full((1, 3), 20.0)}
    climb, theta = np.radians(10.0), np.radians(14.0)
    air = {"chi": 0.0, "gamma": climb, "V_a": 25.0, "theta": theta}
    air = {name: np.full((1, 3), value) for name, value in air.items()}

    over = flights._over_ground(air, {"wind_north": -5.0})

    level = 25.0 * math.cos(climb) - 5.0
    steeper = math.atan2(25.0 * math.sin(climb), level)
    assert over["gamma"] == pytest.approx(np.full((1, 3), steeper))
    assert over["nose"] == pytest.approx(np.full((1, 3), theta - steeper))
    assert over["tail"] == pytest.approx(np.full((1, 3), level - 25.0))
    assert over["chi"] == pytest.approx(np.zeros((1, 3)), abs=1e-12)


def test_a_flight_in_a_steady_wind_starts_as_the_log_and_turns_in_the_air():
    """Over ground it flies with its velocity through the air, turned by 0 to 1 rad, plus the wind.

    The courses of the log are 0.7 rad, and -2.9 rad after a turn.
    """
    wind, later = 3.0 - 4.0j, np.array([[0.0, 0.4, 1.0]])
    chi, V_g = np.array([[0.7], [math.tau - 2.9]]), np.array([[20.0], [18.0]])
    through_air = V_g * np.exp(1j * chi) - wind
    flights = of_log._Flights.__new__(of_log._Flights)
    flights.logged = {"chi": chi + later, "V_g": V_g + later}
    V_a = np.abs(through_air) + 0.0 * later
    air = {"chi": chi + later, "V_a": V_a, "gamma": 0.0 * V_a}

    over = flights._over_ground(air, {"wind_north": wind.real, "wind_east": wind.imag})

    ground = through_air * np.exp(1j * later) + wind
    assert over["chi"][:, 0] == pytest.approx(chi[:, 0])
    assert over["chi"] == pytest.approx(chi + np.angle(ground / ground[:, :1]))
    assert over["tail"] == pytest.approx(np.abs(ground) - V_a)
    assert "nose" not in over


def made_up_log(seconds=60.0, *, without=(), **columns):
    """A level circle at 22 m/s that rolls by 12 deg to and fro, at 20 Hz."""
    t = 0.05 * np.arange(round(20.0 * seconds) + 1)
    made = {
        "chi": np.angle(np.exp(1j * 0.1 * t)), "gamma": 0.02 + 0.0 * t, "V_g": 21.0 + 0.0 * t,
        "V_a": 22.0 + 0.0 * t, "phi": 0.2 * np.sin(t), "n_z": 1.0 + 0.0 * t, "h": 300.0 + t,
        "phi_cmd": 0.2 * np.sin(t + 0.3), "n_z_cmd": 1.1 + 0.0 * t, "theta": 0.09 + 0.0 * t,
    } | columns  # fmt: skip
    return made_up_run({name: x for name, x in made.items() if name not in without}, t)


def test_stretches_have_the_signals_of_the_log_between_its_samples():
    times, logged = of_log._stretches(made_up_log(), 0.02)

    # three of 17 s, from one sample after the end of the one before
    assert times.shape == (3, 850)
    assert times[:, 0] == pytest.approx([0.0, 17.05, 34.1])
    assert np.diff(times) == pytest.approx(np.full((3, 849), 0.02))
    assert logged["chi"] == pytest.approx(0.1 * times)  # without jumps
    assert logged["tail"] == pytest.approx(np.full(times.shape, -1.0))
    assert logged["nose"] == pytest.approx(np.full(times.shape, 0.07))
    assert logged["h"] == pytest.approx(300.0 + times)
    assert (logged["n_z"][0, 0], logged["n_z_cmd"][0, 0]) == (1.0, 1.1)


def test_what_a_log_lacks_is_assumed_or_left_out():
    bare = made_up_log(without=("V_a", "h", "theta", "n_z_cmd"))

    _, logged = of_log._stretches(bare, 0.02)

    assert not {"tail", "nose", "n_z"} & {*logged}
    assert (logged["n_z_cmd"] == 1.0).all()  # its load factor is flown
    assert (logged["h"] == 1000.0).all()
    assert (logged["V_a"] == 21.0).all()  # the ground speed


@pytest.mark.parametrize(
    ("log", "says"),
    [
        (made_up_log(without=("phi_cmd", "V_g")), "must have V_g, phi_cmd to be flown"),
        (made_up_log(without=("n_z", "n_z_cmd")), "must have n_z to be flown on a model"),
        (made_up_log(50.0), "must have 3 stretches of 17 s .* by 5 deg, got 2"),
        (made_up_log(phi_cmd=0.04 * np.sin(0.05 * np.arange(1201))), "got 0"),
    ],
)
def test_a_log_that_cannot_be_flown_says_what_is_missing(log, says):
    with pytest.raises(ft.InputError, match=says):
        of_log._stretches(log, 0.02)


def test_a_difference_is_that_of_common_signals_after_the_start_has_decayed():
    """The first 5 of 12 s do not count; a signal that drifts loses its mean over a stretch."""
    t = np.array([[0.0], [50.0]]) + 0.5 * np.arange(24)
    logged = {"chi": 0.1 + 0.02 * t, "phi": 0.3 + 0.0 * t, "n_z": 1.0 + 0.0 * t, "tail": 0.0 * t}
    flown = {"chi": 0.0 * t, "phi": 0.1 + 0.0 * t, "n_z": np.where(t > 56.0, np.nan, 0.9)}

    found = of_log.difference(t, logged, flown)

    assert {*found} == {"chi", "phi", "n_z"}
    line = 0.02 * 0.5 * (np.arange(14) - 6.5)
    assert found["chi"] == pytest.approx(np.array([line, line]))
    assert found["phi"] == pytest.approx(np.full((2, 14), 0.2))
    scaled = of_log.scaled(t, logged, flown)
    assert scaled.shape == (2, 42)
    assert scaled[0, 28:] == pytest.approx(np.full(14, 0.1 / 0.05))
    assert scaled[1, 28:].tolist() == pytest.approx([2.0] * 3 + [30.0] * 11)  # lost from 56.5 s on
    assert scaled[:, 14:28] == pytest.approx(np.full((2, 14), 0.2 / math.radians(1.0)))
    far = of_log.scaled(t, logged | {"phi": 9.0 + 0.0 * t}, flown)
    assert (far[:, 14:28] == 30.0).all()
    assert of_log.rms(found["n_z"]) == pytest.approx(0.1)
    assert math.isnan(of_log.rms(np.full(3, np.nan)))


@pytest.mark.parametrize(
    ("name", "value", "at_end"),
    [
        ("mass", 0.35, True),  # within a fiftieth of 0.3 to 3
        ("mass", 0.36, False),
        ("mass", 2.94, False),
        ("mass", 2.95, True),
        ("phi_late", -0.93, False),
        ("phi_late", -0.95, True),
        ("wind_east", 49.0, True),
    ],
)
def test_a_factor_is_at_an_end_within_a_fiftieth_of_its_range(name, value, at_end):
    assert of_log.FACTORS[name].at_end(value) == at_end


def flights_of(log, progress=None):
    return of_log._Flights(log, load_aircraft("aerosonde").folder / "identified.json", progress)


def test_an_identified_model_has_neither_mass_nor_damping_and_a_log_says_what_it_lacks():
    whole = flights_of(made_up_log(without=("theta",)))
    # a course that changes by less than 60 deg shows no wind
    straight = flights_of(made_up_log(chi=0.001 * np.arange(1201.0)))
    bare = flights_of(made_up_log(without=("V_a", "h", "theta", "n_z_cmd")))

    lags, wind = ["phi_late", "n_z_late"], ["wind_north", "wind_east"]
    assert [*whole.nominal] == lags + wind
    assert [*straight.nominal] == [*bare.nominal] == lags
    assert [*whole.lower] == ["kinematic", "point_mass"]
    no_airframe = (
        "Not fitted: mass over the model's and damping over the model's, because identified has no "
        "airframe to change."
    )
    assert no_airframe in whole.notes
    said = "Not fitted: air moving north and air moving east, because the {}."
    assert said.format("course changes by less than 60 deg") in straight.notes
    assert bare.notes[-3].startswith("The log has no load-factor commands: its load factor is")
    assert bare.notes[-2] == "The log has no height: the air is that at 1000 m."
    assert bare.notes[-1] == said.format("log has no airspeed")
    assert len(whole.notes) == len(bare.notes) - 3 == len(straight.notes) - 1


def test_a_stretch_starts_as_the_log_with_the_climb_of_its_air():
    """The climb over ground at 21 m/s is that through the air at 22 m/s."""
    start = flights_of(made_up_log())._start(1)

    assert (start.V_a, start.h) == (pytest.approx(22.0), pytest.approx(325.5, abs=0.1))
    assert start.chi == pytest.approx(1.705)
    assert start.phi == pytest.approx(0.2 * math.sin(17.05))
    assert math.sin(start.gamma) == pytest.approx(21.0 / 22.0 * math.tan(0.02))


def test_slopes_of_a_fit_are_those_of_the_difference():
    """They are forward differences over a fifth of the size of each factor."""
    told = []
    flights = flights_of(made_up_log(), lambda *done: told.append(done))
    flights.t = flights.t[:1, :280]  # 0.6 s of one stretch after the wait
    flights.logged = {name: values[:1, :280] for name, values in flights.logged.items()}
    at = {"phi_late": 0.1, "n_z_late": 0.0, "wind_north": 2.0, "wind_east": -3.0}

    slopes = flights.slopes(at)

    def moved(name, by):
        size = of_log.FACTORS[name].size
        return flights.difference(flights.fly(at | {name: at[name] + by * size})).ravel()

    base = flights.difference(flights.fly(at)).ravel()
    for k, name in enumerate(at):
        assert slopes[:, k] == pytest.approx((moved(name, 0.2) - base) / 0.2, abs=1e-9)
    # near a place whose slopes are known those are taken
    again = flights.slopes(at | {"phi_late": 0.19})
    assert again[:, 0] == pytest.approx(slopes[:, 0], abs=1e-9)
    assert np.abs(flights.slopes(at | {"phi_late": -0.01})[:, 0] - slopes[:, 0]).max() > 1e-6
    assert flights.size(flights.fly(at)) == pytest.approx(float(np.sum(base**2)))
    # beyond the upper end a factor is moved down
    high = at | {"wind_north": 49.5}
    down = flights.difference(flights.fly(high | {"wind_north": 48.5})).ravel()
    there = flights.difference(flights.fly(high)).ravel()
    assert flights.slopes(high)[:, 2] == pytest.approx((down - there) / -0.2, abs=1e-9)
    # each flight brings the end nearer
    names, shares = zip(*told, strict=True)
    assert {*names} == {"identified"}
    assert 0.0 < shares[0] < shares[-1] < 1.0
    assert sorted(shares) == [*shares]


def test_stretches_that_an_aircraft_cannot_start_are_left_out():
    """The second of four, at 40 m/s."""
    flights = flights_of(made_up_log(75.0))
    flights.logged["V_a"][1] = 40.0

    class Slow(PointMassPlant):
        def start(self, condition):
            if condition.V_a > 30.0:
                raise ft.loop.PlantError("Too fast.")
            super().start(condition)

    flights._maker = lambda _: Slow()
    flights._keep_flyable()

    assert flights.t[:, 0] == pytest.approx([0.0, 34.1, 51.15])
    assert (flights.logged["V_a"] == 22.0).all()
    assert flights.notes[-1] == "1 of 4 stretches are left out: Too fast."
    flights.logged["V_a"][1] = 40.0
    with pytest.raises(ft.InputError, match=r"must fly 3 stretches .* got 2: Too fast"):
        flights._keep_flyable()


def test_a_track_without_an_aircraft_to_fly_it_is_not_compared():
    straight = {"chi": 0.001 * np.arange(1201.0), "cross_track": np.full(1201, 1.5)}
    flights = flights_of(made_up_log(**straight))

    assert flights.tracking("nothing") == ()  # an identified model flies no route
    notes = len(flights.notes)
    flights._file = False
    assert flights.tracking("nothing") == ()

    assert len(flights.notes) == notes + 1
    assert flights.notes[-1].startswith("No straight flights to compare the log's track with: ")
    assert "nothing" in flights.notes[-1]


@pytest.mark.slow
def test_damping_is_fitted_where_a_model_names_it(tmp_path):
    named = of_log._Flights(made_up_log(), "aerosonde", None)
    other = changed_aerosonde(
        tmp_path / "other", lambda text: re.sub("C([lm])_?([pq])", r"X\1\2", text)
    )
    without = of_log._Flights(made_up_log(), other, None)

    assert [*named.nominal] == [*of_log.FACTORS]
    assert [*without.nominal] == [name for name in of_log.FACTORS if name != "damping"]
    (said,) = [note for note in without.notes if note.startswith("Not fitted: damping")]
    assert "other has no aerodynamics named Clp, Cl_p, Cmq, Cm_q" in said
    assert [*named.lower] == ["kinematic", "point_mass", "point_mass_lag"]
    assert named.t[0, 1] == pytest.approx(0.02)  # four steps of its inner loop


def test_commands_of_a_log_are_flown_as_much_later_as_the_factors_say():
    """A point mass follows at once what is held for 0.02 s, which is the command at its middle."""
    flights = flights_of(made_up_log(n_z_cmd=1.02 + 0.1 * np.sin(0.05 * np.arange(1201))))

    flown = flights.fly({"phi_late": 0.1, "n_z_late": -0.05}, lambda _: PointMassPlant())

    t = flights.t
    assert np.diff(t) == pytest.approx(np.full((3, 849), 0.02))
    within = slice(20, -20)  # commands beyond the ends of a stretch are not known
    for name, command, delay in (
        ("phi", lambda t: 0.2 * np.sin(t + 0.3), 0.1),
        ("n_z", lambda t: 1.02 + 0.1 * np.sin(t), -0.05),
    ):
        acted = command(t[:, :-1] + 0.01 - delay)  # during the sample that ends here
        assert flown[name][:, 1:][:, within] == pytest.approx(acted[:, within], abs=1e-4)


def test_a_flight_that_ends_early_has_no_signals_after_its_end():
    class Ended(PointMassPlant):
        def advance(self, phi_cmd, n_z_cmd, dt):
            self.steps = getattr(self, "steps", 0) + 1
            return super().advance(phi_cmd, n_z_cmd, dt) or (
                ft.loop.Stop("left_envelope", "too far") if self.steps == 7 else None
            )

    flown = flights_of(made_up_log()).fly({}, lambda _: Ended())

    assert np.isfinite(flown["chi"]).sum(axis=1).tolist() == [7, 7, 7]
    assert np.isfinite(flown["chi"][:, :7]).all()


class MadeUpFlights(of_log._Flights):
    """Flights whose difference is a sum over scaled factors about their truth, and errors."""

    def __init__(self, truth, effects, errors=0.0, law=lambda change: change):
        self.nominal = {name: of_log.FACTORS[name].nominal for name in truth}
        self.truth, self.effects, self.errors, self.law = truth, effects, errors, law
        self.t, self.notes, self._places = np.zeros((5, 1)), [], []

    def fly(self, factors, maker=None):
        return dict(factors)

    def difference(self, flown):
        apart = np.zeros((5, 4)) + self.errors
        for name, effect in self.effects.items():
            x = flown.get(name, of_log.FACTORS[name].nominal) - self.truth[name]
            apart = apart + np.array(effect) * self.law(x / of_log.FACTORS[name].size)
        return apart


EVEN, ODD = (1.0, 0.0, 1.0, 0.0), (0.0, 1.0, 0.0, 1.0)


def test_factors_of_a_log_are_means_over_its_stretches_with_students_intervals():
    """Samples show a factor each; the age of commands is known to 0.02 s, half to each side."""
    errors = np.random.default_rng(4).normal(scale=0.4, size=(5, 2))
    truth = {"mass": 1.3, "phi_late": 0.25, "wind_east": 41.0}
    effects = {"mass": EVEN, "phi_late": ODD}
    flights = MadeUpFlights(truth, effects, errors[:, [0, 1, 0, 1]])

    found = of_log._fitted(flights)

    assert [*found] == ["mass", "phi_late"]
    aged = {"mass": 0.0, "phi_late": 0.95 * 0.02 / 2.0}
    for (name, (value, low, high)), error in zip(found.items(), errors.T, strict=True):
        size = of_log.FACTORS[name].size
        assert value == pytest.approx(truth[name] - size * error.mean())
        half = student.ppf(0.975, 4) * size * error.std(ddof=1) / math.sqrt(5.0)
        half = math.hypot(half, aged[name])
        assert (low, high) == pytest.approx((value - half, value + half))
    (said,) = flights.notes
    assert "air moving east" in said
    assert said.endswith("it is taken as 0.")


def test_a_factor_that_a_log_cannot_identify_is_taken_as_nominal():
    """Two with the same effect, one whose interval is wide, and one beyond its range."""
    for effect in (EVEN, 0.0):
        alone = MadeUpFlights({"mass": 0.1}, {"mass": effect})
        assert of_log._fitted(alone) == {}
        assert len(alone.notes) == 1
    alike = MadeUpFlights({"mass": 1.2, "damping": 1.0}, {"mass": EVEN, "damping": EVEN})
    spread = np.array([[-6.0], [6.0], [-5.0], [5.0], [0.0]]) * ODD
    vague = MadeUpFlights({"mass": 1.2, "wind_north": 2.0}, {"mass": EVEN, "wind_north": ODD},
                          spread)  # fmt: skip
    beyond = MadeUpFlights({"mass": 0.1, "wind_north": 41.0}, {"mass": EVEN, "wind_north": ODD})

    fits = [of_log._fitted(flights) for flights in (alike, vague, beyond)]

    values = [{name: value for name, (value, _, _) in fit.items()} for fit in fits]
    assert values[0] == pytest.approx({"damping": 1.4})  # a size of 0.4 in place of one of 0.2
    assert values[1] == pytest.approx({"mass": 1.2})
    assert values[2] == pytest.approx({"wind_north": 41.0})
    for flights, words in (
        (alike, "mass over the model's: a change of it has the same effect as changes of the "),
        (vague, "air moving north: its interval at 95 %, "),
        (beyond, "mass over the model's: the best fit is at an end of its range, 0.3 to 3"),
    ):
        (said,) = flights.notes
        assert said.startswith(f"The log cannot identify {words}")


@pytest.mark.parametrize(
    ("clear", "vague"), [("wind_north", "mass"), ("mass", "wind_north"), ("mass", "damping")]
)
def test_of_factors_that_only_noise_parts_the_one_that_is_known_worse_is_left_out(clear, vague):
    """They have the same effect but for a sample full of noise, one of them half as much."""
    truth = {name: of_log.FACTORS[name].nominal for name in (clear, vague)}
    truth[clear] += 0.3 * of_log.FACTORS[clear].size
    noise = np.random.default_rng(2).normal(scale=2.0, size=(5, 1)) * (0.0, 0.0, 1.0, 0.0)
    effects = {clear: (1.0, 1.0, 0.0, 0.0), vague: (0.5, 0.5, 0.2, 0.0)}

    flights = MadeUpFlights(truth, effects, noise)

    assert [*of_log._fitted(flights)] == [clear]
    (said,) = flights.notes
    assert of_log.FACTORS[vague].title in said


def test_intervals_of_factors_do_not_depend_on_their_values():
    random = np.random.default_rng(6)
    effects = dict(zip(("mass", "wind_north"), random.normal(size=(2, 5, 4)), strict=True))
    errors = random.normal(scale=0.1, size=(5, 4))

    near, far = (
        of_log._fitted(MadeUpFlights({"mass": mass, "wind_north": north}, effects, errors))
        for mass, north in ((1.1, 1.0), (1.9, -13.0))
    )

    for (value, low, high), (other, below, above) in zip(near.values(), far.values(), strict=True):
        assert abs(value - other) > 4.0 * (high - low) > 0.0
        assert above - below == pytest.approx(high - low, rel=1e-6)


def test_steps_of_a_fit_are_halved_while_they_lead_away(monkeypatch):
    """Newton's step is too long for an arctangent of three times the distance, 1.4 sizes at first.

    Of three sizes at most it leads from 1.4 below the truth to 1.6 above it.
    """
    curved = MadeUpFlights(
        {"wind_north": 7.0}, {"wind_north": EVEN}, law=lambda x: np.arctan(3.0 * x)
    )

    found = of_log._fitted(curved)

    assert found["wind_north"][0] == pytest.approx(7.0, abs=0.05)
    assert curved.notes == []
    monkeypatch.setattr(of_log, "MAX_STEPS", 2)
    far = MadeUpFlights({"mass": 1.0, "wind_north": 41.0}, {"mass": ODD, "wind_north": EVEN})
    assert of_log._fitted(far)["wind_north"][0] == pytest.approx(30.0)
    assert far.notes == ["The fit still moved after 2 steps: its factors are rough."]
