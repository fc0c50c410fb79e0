"""A log of our own flight with a known change, against the model that flies its commands."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from commands import answer
from log_files import heavy_cessna, sampled, write_csv
from made_up import made_up_scenario
from places import SHIPPED_AIRCRAFT

import flighttune as ft

MASS, LATE, WIND = 1.2, 0.15, (3.0, 3.0 * math.sqrt(3.0))
"""Of the flight: mass over the model's; s; m/s to the north and to the east."""
HELD = 0.01
"""Half a sample of the controller, by which a command that is held comes later, s."""
MASS_ERROR, LAG_ERROR, WIND_ERROR = 0.05, 0.01, 0.1
"""Allowed with noise, dropouts and late stamps at 25 Hz."""
MODEL = str(SHIPPED_AIRCRAFT / "aerosonde/identified.json")
MOVING = 4.0, -6.0
"""Air of the flight on the law, m/s to the north and to the east."""
SIGNALS = ["chi", "gamma", "phi", "n_z", "V_a", "V_g", "h", "phi_cmd", "n_z_cmd"]


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
    assert [row["flown"] for row in told["differences"]] == [
        *("kinematic", "point_mass", "point_mass_lag", "c172p", "c172p, explained")
    ]
    assert explained["phi"] < 0.2 * aircraft["phi"] < aircraft["phi"] < law["phi"]
    assert (log.parent / "gap" / "gap.svg").stat().st_size > 10_000


@pytest.fixture(scope="module")
def table():
    """Signals of the lags of the Aerosonde alone, which weave in moving air for 54 s."""
    north, east = MOVING
    turns = [80.0 - 125.0 * (k % 2) for k in range(9)]
    steps = [{"shape": "step", "start_s": 0.5 + 6.0 * k, "change_deg": x} for k, x in
             enumerate(turns)]  # fmt: skip
    climbs = [{"shape": "step", "start_s": 2.0 + 5.0 * k, "change_deg": (-1.0) ** k * 4.0} for k in
              range(10)]  # fmt: skip
    scenario = made_up_scenario(
        plant=[{"kind": "point_mass_lag", "identified": MODEL}],
        flight={"duration_s": 54.0, "h_m": 700.0, "g_mps2": 9.80665},
        gains=[{"name": "own", "K_P": [[2.0, 0.0], [0.0, 2.0]], "K_I": [[0.1, 0.0], [0.0, 0.2]]}],
        reference={"chi_deg": steps, "gamma_deg": climbs},
        limits={"phi_deg": [-40.0, 40.0], "n_z": [0.5, 1.8]},
        controller={"feed_forward": True},
    )
    run = ft.fly(scenario).runs[0].signals
    level = run["V_a"] * np.cos(run["gamma"])
    to_north = level * np.cos(run["chi"]) + north
    to_east = level * np.sin(run["chi"]) + east
    V_g = np.hypot(to_north, to_east)
    over = {
        "chi": np.unwrap(np.arctan2(to_east, to_north)), "V_g": V_g, "theta": run["gamma"] + 0.05,
        "gamma": np.arctan2(run["V_a"] * np.sin(run["gamma"]), V_g),
        "h": 700.0 + np.cumsum(run["V_a"] * np.sin(run["gamma"])) * 0.02,
    }  # fmt: skip
    return run.assign(**over)[[*SIGNALS, "theta"]].rename_axis("t_s")


def written(folder, table, **columns):
    file = folder / "flight.csv"
    table.assign(**columns).to_csv(file)
    return file


def gap_of(folder, table, **columns):
    return ft.gap(written(folder, table, **columns), aircraft=MODEL)


def late(table, name, seconds):
    """A command that is stamped so much earlier."""
    return np.interp(table.index + seconds, table.index, table[name])


@pytest.fixture(scope="module")
def found(table, tmp_path_factory):
    """The gap of the flight, whose roll command is stamped 0.1 s early."""
    folder = tmp_path_factory.mktemp("gap")
    return gap_of(folder, table, phi_cmd=late(table, "phi_cmd", 0.1))


@pytest.mark.soak
def test_a_flight_of_the_model_differs_by_wind_and_delays_alone(found):
    values = {name: value for name, (value, _, _) in found.factors.items()}

    assert (values["wind_north"], values["wind_east"]) == pytest.approx(MOVING, abs=WIND_ERROR)
    assert values["phi_late"] == pytest.approx(0.1 + HELD, abs=0.3 * LAG_ERROR)
    assert values["n_z_late"] == pytest.approx(HELD, abs=0.3 * LAG_ERROR)
    assert all(low < value < high for value, low, high in found.factors.values())
    # a delay is known no better than the age of a command, which is uniform up to 0.02 s
    assert np.ptp(found.factors["phi_late"]) >= 0.95 * 0.02
    assert found.explained > 0.998
    (lag, without_lag), (air, without_air) = found.causes["lag"], found.causes["wind"]
    assert lag + air == pytest.approx(1.0, abs=0.05)
    assert (without_lag, without_air) == pytest.approx((lag, air), abs=0.05)
    assert found.tracking == ()
    (said,) = found.notes  # an identified model has no airframe to change
    assert "mass" in said
    assert "damping" in said


@pytest.mark.slow
def test_differences_are_those_of_the_signals_of_log_and_model(found, table):
    """Samples of the first 5 of 17 s do not count; what drifts loses its mean in a stretch."""
    rows = {row["flown"]: row for row in found.answer().tables[0].records}

    assert [*rows][:2] == ["kinematic", "point_mass"]
    assert found.t.shape == (3, 850)
    assert np.diff(found.t[:, 0]).min() >= 17.0
    at = (found.t / 0.02).round().astype(int)
    for name in ("phi", "n_z"):
        assert found.logged[name] == pytest.approx(table[name].to_numpy()[at], abs=1e-6)
    assert found.logged["tail"] == pytest.approx(found.logged["V_g"] - found.logged["V_a"])
    assert found.logged["nose"] == pytest.approx(
        table["theta"].to_numpy()[at] - found.logged["gamma"], abs=1e-6
    )
    for name in ("phi", "n_z", "chi"):
        for flown, signals in found.flights.items():
            apart = (found.logged[name] - signals[name])[:, 250:]
            if name == "chi":
                apart = apart - apart.mean(axis=1, keepdims=True)
            expected = math.sqrt(np.mean(apart**2))
            assert rows[flown][name] == pytest.approx(expected, rel=1e-6)
    scales = dict.fromkeys(("chi", "gamma", "phi", "nose"), math.radians(1.0))
    scales |= {"n_z": 0.05, "tail": 0.5}
    whole, left = (
        sum((row[name] / scale) ** 2 for name, scale in scales.items() if name in row)
        for row in (rows[found.aircraft], rows[f"{found.aircraft}, explained"])
    )
    assert found.explained == pytest.approx(1.0 - left / whole, abs=1e-4)


@pytest.mark.slow
def test_the_picture_has_the_log_its_command_and_every_flight_in_degrees(found, tmp_path):
    found.sheet().save(tmp_path / "gap.svg")

    drawn = (tmp_path / "gap.svg").read_text(encoding="utf-8")
    for label in ("chi [deg]", "gamma [deg]", "phi [deg]", "n_z [1]"):
        assert label in drawn
    assert all(name in drawn for name in (*found.flights, "command", "log"))


@pytest.mark.soak
def test_a_log_that_is_mirrored_and_turned_has_its_wind_mirrored_and_turned(table, tmp_path):
    by, early = math.radians(200.0), late(table, "phi_cmd", 0.1)

    gap = gap_of(tmp_path, table, phi_cmd=-early, phi=-table["phi"], chi=by - table["chi"])

    values = {name: value for name, (value, _, _) in gap.factors.items()}
    turned = complex(MOVING[0], -MOVING[1]) * np.exp(1j * by)
    assert values["wind_north"] + 1j * values["wind_east"] == pytest.approx(turned, abs=WIND_ERROR)
    assert values["phi_late"] == pytest.approx(0.1 + HELD, abs=0.3 * LAG_ERROR)
    assert values["n_z_late"] == pytest.approx(HELD, abs=0.3 * LAG_ERROR)
    assert gap.explained > 0.998


@pytest.mark.soak
def test_what_a_log_lacks_is_assumed_and_said_and_a_stretch_begins_after_a_gap(table, tmp_path):
    twice = pd.concat([table, table.iloc[1:].set_axis(table.index[1:] + 54.0)]).rename_axis("t_s")
    missing = (twice.index > 30.0) & (twice.index < 30.5) | (twice.index > 80.0)
    lacking = ["V_a", "h", "theta", "n_z_cmd"]

    gap = gap_of(tmp_path, twice[~missing].drop(columns=lacking))

    said = " ".join(gap.notes)
    for words in (
        "no height: the air is that at 1000 m",
        "air moving north and air moving east, because the log has no airspeed",
        "no load-factor commands",
    ):
        assert words in said
    assert not {"tail", "nose", "n_z"} & {*gap.logged}
    assert (gap.logged["h"] == 1000.0).all()
    assert np.array_equal(gap.logged["V_a"], gap.logged["V_g"])
    assert gap.factors["phi_late"][0] == pytest.approx(HELD, abs=0.05)
    assert not any((row[0] <= 30.0) & (row[-1] >= 30.5) for row in gap.t)
    assert (np.diff(gap.t[:, 0]) >= 17.0).all()
    assert gap.t[1, 0] == pytest.approx(30.5, abs=0.05)


@pytest.mark.soak
def test_a_log_that_is_noise_tells_no_delay_and_one_that_flies_straight_no_wind(table, tmp_path):
    random = np.random.default_rng(3)
    noisy = {
        name: table[name] + 0.5 * random.standard_normal(len(table)) for name in ("phi", "n_z")
    }

    gap = gap_of(tmp_path, table, **noisy, chi=0.3 + 0.01 * np.sin(table.index.to_numpy()))

    for value, low, high in gap.factors.values():
        assert low < value < high
    said = [x for x in gap.notes if x.startswith("The log cannot identify")]
    assert len(gap.factors) == 2 - len(said)
    for words in said:
        assert re.search(r"at an end of its range|holds [01] and is too wide|same effect", words)
    assert any("less than 60 deg" in x for x in gap.notes)


REFUSED = [
    ({"phi_cmd": None}, "must have phi_cmd to be flown"),
    ({"n_z": None, "n_z_cmd": None}, "must have n_z to be flown"),
    ({"phi_cmd": 0.02}, "by 5 deg, got 0"),
    ({"end": 50.0}, "3 stretches of 17 s .*, got 2"),
]


@pytest.mark.parametrize(("columns", "words"), REFUSED)
def test_a_log_that_cannot_be_flown_says_what_is_missing(table, tmp_path, columns, words):
    made = table.loc[: columns.get("end", 60.0)]
    made = made.drop(columns=[name for name, x in columns.items() if x is None])
    constant = {name: x for name, x in columns.items() if x is not None and name != "end"}

    with pytest.raises(ft.InputError, match=words):
        gap_of(tmp_path, made, **constant)


@pytest.mark.slow
def test_a_log_that_an_aircraft_cannot_fly_says_how_many_stretches_it_can(table, tmp_path):
    """Its envelope has no 25 m/s."""
    with pytest.raises(ft.InputError, match=r"a4: must fly 3 stretches .* got 0: .*V_a"):
        ft.gap(written(tmp_path, table), aircraft="a4")
