"""Rows of runs: the same bits however runs are divided, and what `fly` says of the same flight."""

import re
import signal
from itertools import pairwise
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pyarrow as pa
import pytest
from dispersed import (
    AEROSONDE,
    KINEMATIC,
    SOFT,
    TURBULENCE,
    WIND,
    one_of,
    plan_of,
    tables_of,
    uniform,
)
from flown_campaigns import bits, table_flown
from hypothesis import given, settings
from hypothesis import strategies as st

import flighttune as ft
from flighttune.campaigns.flying import columns
from flighttune.campaigns.flying import rows as flying
from flighttune.control.margins import channel_margins
from flighttune.flight import models

BOUNDS = {"at_most": {"chi": {"peak_deg": 21.0}, "flight": {"alpha_max_rad": 0.3}}}
START = (uniform("flight.chi_deg", 10.0, 30.0), uniform("flight.V_a_mps", 23.0, 27.0))


def still_plan(*disperse, plants=(KINEMATIC, AEROSONDE), **tables):
    tables = tables_of(plants, expect=[BOUNDS], **tables)
    tables["flight"]["duration_s"] = 1.0
    return plan_of(tables, *START, *disperse, runs=16)


def windy_plan():
    """Law, point mass and aircraft in turbulence: the first two replay what the last met."""
    air = {"wind": WIND, "turbulence": TURBULENCE}
    drawn = uniform("wind.from_deg", 0.0, 360.0)
    return still_plan(drawn, plants=(KINEMATIC, {"kind": "point_mass"}, AEROSONDE), **air)


@pytest.fixture(scope="module", params=[windy_plan, still_plan], ids=["wind", "still air"])
def whole(request):
    plan = request.param()
    return plan, table_flown(plan)


@pytest.mark.soak
@settings(max_examples=6)
@given(data=st.data())
def test_rows_are_the_same_however_runs_are_divided_into_chunks(whole, data):
    plan, rows = whole
    order = data.draw(st.permutations(range(plan.runs)))
    cuts = sorted(data.draw(st.sets(st.integers(1, plan.runs - 1), max_size=4)))
    wanted = data.draw(st.sampled_from([slice(None), slice(0, 1), slice(-1, None)]))
    edges = [0, *cuts, plan.runs]
    chunks = [order[a:b] for a, b in pairwise(edges)][wanted]

    found = pa.concat_tables([table_flown(plan, chunk) for chunk in chunks]).sort_by("run")

    runs = [run for chunk in chunks for run in chunk]
    assert bits(found) == bits(rows.take(sorted(runs)))


@pytest.mark.soak
def test_a_row_is_what_fly_says_of_the_scenario_of_its_draw(whole):
    plan, rows = whole
    for draw in range(2):
        flown = ft.fly(plan.scenario_of(draw))
        for row in rows.filter(pa.compute.equal(rows["draw"], draw)).to_pylist():
            run = next(
                r for r in flown.runs
                if (r.provenance.plant, r.provenance.gains_name) == (row["plant"], row["gains"])
            )  # fmt: skip
            assert (row["status"], row["reason"]) == (run.status, run.reason)
            for subject, metrics in flown.metrics_of(run).items():
                for name, value in metrics.items():
                    got = np.nan if row[f"{subject}.{name}"] is None else row[f"{subject}.{name}"]
                    assert got == pytest.approx(value, rel=1e-12, nan_ok=True)
            for channel in ("chi", "gamma"):
                peak = np.abs(run.signals[f"{channel}_err"]).max()
                assert row[f"{channel}.peak_rad"] == pytest.approx(peak, rel=1e-12)
            said = [one for one in flown.claim.missed if one.startswith(f"{run.label}: ")]
            assert row["missed"] == "; ".join(one.removeprefix(f"{run.label}: ") for one in said)
            assert row["success"] == (not said)
            found = flown.indicators[row["gains"]]
            assert (row["R_K"], row["I_K"], row["E_K"]) == (found.R_K, found.I_K, found.E_K)
            drawn = plan.values_of(draw)
            assert {key: row[key] for key in drawn} == drawn


def test_the_schema_is_that_of_the_plan_with_units(whole):
    plan, rows = whole

    assert rows.schema.equals(columns.row_schema(plan), check_metadata=True)
    assert table_flown(plan, []).schema.equals(columns.row_schema(plan), check_metadata=True)
    units = {f.name: f.metadata[b"unit"].decode() for f in rows.schema if f.metadata}
    assert units["flight.V_a_mps"] == "m/s"
    assert units["chi.ITAE"] == "rad s^2"
    assert units["gamma.effort_rms"] == units["flight.n_z_max"] == "1"
    numbers = [f.name for f in rows.schema if pa.types.is_floating(f.type)]
    assert set(numbers) <= set(units)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("flight.V_a_mps", value) for value in (np.nan, -3.0, 80.0)),
        ("flight.gamma_deg", np.nan),
        ("plant.airframe.mass_factor", np.nan),
        ("sensors.chi_noise_sd_deg", -1.0),
    ],
)
def test_a_drawn_value_that_is_refused_is_a_row_that_names_its_key(key, value):
    plan = plan_of(tables_of((AEROSONDE,)), one_of(key, value), runs=2)

    rows = table_flown(plan).to_pylist()

    for row in rows:
        assert row["status"] == "invalid"
        assert f"`{key.split('.')[-1]}`" in row["reason"]
        assert "\n" not in row["reason"]
        assert not row["success"]
        assert row["missed"] == f"invalid: {row['reason']}"
        assert row[key] == value or np.isnan(value)
        assert row["chi.ITAE"] is row["R_K"] is None
        assert row["wall_s"] >= 0.0


@pytest.mark.soak
def test_gains_that_tuning_did_not_find_are_rows_too():
    tables = tables_of(gains=["tuned", "paper"], tuning={"I_star": 1e-6})
    plan = plan_of(tables, *START, runs=4)
    assert plan.gain_sets["tuned"] is None

    rows = table_flown(plan).to_pylist()

    assert [row["status"] for row in rows] == ["no_gains", "completed"] * 2
    assert rows[0]["R_K"] is None
    with pytest.raises(ft.InputError, match=r"`gains` .* none for tuned"):
        flying.scenario_of_run(plan, 0)
    with pytest.raises(ft.InputError, match=r"`run` .*3.* 4"):
        flying.scenario_of_run(plan, 4)


@pytest.mark.slow
def test_a_start_without_steady_flight_and_a_flight_into_the_ground_are_rows():
    tables = tables_of((AEROSONDE,), gains=["paper"], controller={"feed_forward": True})
    tables["flight"].update(gamma_deg=0.0, ground_m=0.0, duration_s=4.0)
    tables["reference"]["gamma_deg"] = -60.0
    plan = plan_of(
        tables, one_of("plant.throttle_max", 0.02, 1.0), one_of("flight.h_m", 20.0, 500.0), runs=20
    )

    rows = table_flown(plan).to_pylist()

    for row in rows:
        weak, low = row["plant.throttle_max"] < 1.0, row["flight.h_m"] < 100.0
        expected = "no_trim" if weak else "ground_contact" if low else "completed"
        assert row["status"] == expected
        assert row["success"] == (expected == "completed")
        assert (row["chi.ITAE"] is None) == weak
        assert bool(row["reason"]) == (expected != "completed")
    assert {row["status"] for row in rows} == {"no_trim", "ground_contact", "completed"}


@pytest.mark.parametrize("run", [-1, 16])
def test_a_run_that_is_not_of_the_plan_is_refused(run):
    with pytest.raises(ft.InputError, match=rf"`run` must be 0 to 15, got {run}\."):
        flying.scenario_of_run(still_plan(), run)


def test_the_row_of_a_crashed_run_is_a_row_of_the_plan():
    plan = still_plan()

    row = flying.lost_row(plan, 7, plan.values_of(plan.draw_of(7)), -signal.SIGSEGV)

    assert flying.lost_row(plan, 7, None, -signal.SIGSEGV) == row  # as of a batch of many draws
    (found,) = columns.table_of(plan, [row]).to_pylist()
    whole = table_flown(plan, [7]).to_pylist()[0]
    assert found["status"] == "crashed"
    assert found["missed"] == "crashed: the flight ended the process that flew it: SIGSEGV"
    assert not found["success"]
    assert found["chi.ITAE"] is found["wall_s"] is None
    for name in ("run", "draw", "plant", "gains", "seed", *plan.keys, "R_K", "I_K", "E_K"):
        assert found[name] == whole[name]
    refused = flying.lost_row(plan, 0, dict.fromkeys(plan.values_of(0), -1.0), -signal.SIGSEGV)
    assert refused["status"] == "crashed"
    assert refused["R_K"] is refused["I_K"] is refused["E_K"] is None


@pytest.mark.soak
def test_the_scenario_of_a_run_has_gains_as_numbers_whatever_their_name():
    tables = tables_of(gains=["tuned", SOFT], tuning={"I_star": 8.0}, expect=[
        {"gains": "tuned", "status": "completed"}, {"gains": "soft", "status": "diverged"},
    ])  # fmt: skip
    plan = plan_of(tables, *START, runs=4)

    scenario = flying.scenario_of_run(plan, 2)

    (gains,) = scenario.gains
    assert gains.name == "tuned"
    assert gains.gains() == plan.gain_sets["tuned"]
    assert [table.gains for table in scenario.expect] == ["tuned"]


ENDINGS = {"rad": "rad", "s": "s", "m": "m", "mps": "m/s"}
"""Units that a name tells; others stand in brackets behind the name, a number has none."""


def test_the_columns_in_the_documentation_are_those_of_the_schema():
    page = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
    listed = page.split("The columns, in SI")[1].split("\nA value that")[0].replace("²", "^2")
    names = {*re.findall(r"`(?:chi\.)?([\w.]+)`", listed)}

    def told(name):
        behind = re.search(rf"`(?:chi\.)?{name}`(?:, `\w+`)* \(([^)]+)\)", listed)
        ending = ENDINGS.get(name.rpartition("_")[2])
        return ending or (behind[1] if behind and len(behind[1].split()) < 3 else "1")

    for field in columns.row_schema(plan_of(tables_of())):
        channel, _, short = field.name.rpartition(".")
        name = field.name if field.name in names else short
        assert name in names
        assert channel in ("", "flight", "chi", "gamma")
        if field.metadata and short != "effort_rms":  # its unit differs by channel
            assert told(name) == field.metadata[b"unit"].decode(), name
    assert "`effort_rms` (rad of `chi`, 1 of `gamma`)" in listed


def test_a_bound_on_the_loop_is_in_every_row_and_its_margins_are_computed_once(monkeypatch):
    counted = Mock(side_effect=channel_margins)
    monkeypatch.setattr(models, "channel_margins", counted)
    bound = {"at_least": {"loop": {"phase_margin_deg": 179.0}}}
    plan = plan_of(tables_of((KINEMATIC,), gains=["paper", "K3"], expect=[bound]), *START, runs=8)

    rows = table_flown(plan).to_pylist()

    assert all("loop.phase_margin_deg must be at least 179" in row["missed"] for row in rows)
    assert counted.call_count == len(plan.groups) == 2


@pytest.mark.slow
def test_the_compiled_samples_of_a_route_are_loaded_before_its_runs_are_timed(monkeypatch):
    pytest.importorskip("numba")
    from flighttune.flight.loop import compiled

    parts, fly = [], compiled.fly_samples
    monkeypatch.setattr(compiled, "fly_samples", lambda *x: parts.append(x[6][:2]) or fly(*x))

    flying.warm_up(ft.plan_campaign(ft.load_campaign("circuit_in_wind", gains=["paper"])))

    assert parts == [(0, 0)]
