"""Tubes of flights: found by their hash, made where asked, drawn in recording, report and gap."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaigns import flown_here
from commands import answer, flighttune

from flighttune import record
from flighttune.campaign import conform as conform_module
from flighttune.campaign.conform import ConformSettings, conform
from flighttune.campaign.stated_set import planned
from flighttune.cli.tube import tubes_answer
from flighttune.control.gains import PAPER_GAINS
from flighttune.flight.fly import fly
from flighttune.flight.gap import explain_flight
from flighttune.flight.gap_charts import bound_chart
from flighttune.recording.parquet import load_recording
from flighttune.recording.plots import shown_plots, value_range
from flighttune.scenario import load_scenario, scenario_from
from flighttune.seal import BLANK, seal
from flighttune.simulate.run import TUBE_SIGNALS
from flighttune.table_file import toml_text
from flighttune.tube.store import ABOUT, SEAL, run_sha256, tubes_of, write_sealed, write_worst
from tests.tube.test_aircraft import conformance, flight
from tests.tube.test_soundness import tube

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flown():
    """A gentle turn on the law and on the aircraft."""
    tables = flight().as_dict()
    tables["plant"] = [{"kind": "kinematic"}, *tables["plant"]]
    return fly(scenario_from(tables | {"gains": ["paper"], "expect": []}))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("runs")


def boxes(flown, **widths):
    known = conformance(flown.scenario, **widths)
    fixed = conformance(flight()).distribution.fixed
    return replace(known, distribution=replace(known.distribution, fixed=fixed))


@pytest.fixture(scope="module")
def tubes(flown, folder):
    return tubes_of(flown.runs, folder, make=True, conformance=boxes(flown))


def test_every_run_is_inside_its_tube_and_carries_it(flown, tubes):
    assert tubes.why_not == {}
    assert set(tubes.tubes) == {run.label for run in flown.runs}
    assert tubes.outside == ()
    for run in tubes.runs:
        low, high = (run.signals[name] for name in TUBE_SIGNALS[:2])
        assert (low < high).all()
        assert run.signals["chi_err"].between(low, high).all()


def test_they_are_found_again_by_hash_and_not_for_other_gains(flown, tubes, folder):
    again = tubes_of(flown.runs, folder)
    assert again.tubes.keys() == tubes.tubes.keys()
    # A tube of an earlier run is not said to be proven now.
    assert {tube.computed for tube in tubes.tubes.values()} == {True}
    assert {tube.computed for tube in again.tubes.values()} == {False}

    run = flown.runs[0]
    gains = replace(run.provenance.gains, K_P=2.0 * run.provenance.gains.K_P)
    other = replace(run, provenance=replace(run.provenance, gains=gains))
    assert run_sha256(other) != run_sha256(run)
    assert tubes_of([other], folder).tubes == {}


def test_the_tube_of_an_aircraft_without_its_conformance_is_refused_by_name(flown, tmp_path):
    found = tubes_of(flown.runs[1:], tmp_path, make=True)

    assert list(found.why_not) == ["jsbsim:aerosonde / paper"]
    assert "`flighttune conform` makes one" in found.why_not["jsbsim:aerosonde / paper"]


def test_a_recording_has_them_as_bands_and_flies_again(flown, tubes, tmp_path):
    files = record(replace(flown, runs=tubes.runs), tmp_path)

    runs = load_recording(tmp_path).runs
    (plot,) = (one for one in shown_plots(runs)["Tracking"] if one.signal == "chi_err")
    assert plot.tube[:2] == TUBE_SIGNALS[:2]
    low, high = value_range(plot, runs, share=0.4)
    widest = max(np.rad2deg(run.signals["chi_err_high"].max()) for run in runs)
    assert low < widest < high
    flighttune("refly", files.recording)


def test_the_gap_figure_shows_the_tube_in_place_of_the_certified_set(flown, tubes):
    gap = explain_flight(flown.scenario, tubes.runs[1])

    legend = [name for name, *_ in bound_chart(gap, "chi").legend]

    assert legend == ["error", "its tube in calm air, flight inside"]


def test_the_worst_flight_found_is_drawn_beside_its_tube(flown, tubes, folder, tmp_path):
    copied = shutil.copytree(folder, tmp_path / "runs")
    label = flown.runs[0].label
    path = copied / "tubes" / tubes.tubes[label].file.name
    command = f"flighttune worst SCENARIO|CAMPAIGN --tube {tubes.tubes[label].file}"
    assert any(command in note for note in tubes_answer(tubes, "").notes)
    command = "flighttune worst mine.toml --gains paper --plant kinematic"
    assert any(command in note for note in tubes_answer(tubes, "", "mine.toml").notes)

    write_worst(path, flown.runs[1], {"chi": 1.5, "gamma": 2.25})

    again = tubes_of(flown.runs, copied)
    drawn = again.runs[0]
    assert again.tubes[label].about.worst == {"chi": 1.5, "gamma": 2.25}
    assert drawn.signals["chi_err_worst"].tolist() == flown.runs[1].signals["chi_err"].tolist()
    files = record(replace(flown, runs=again.runs), tmp_path / "drawn")
    flighttune("refly", files.recording)
    page = tmp_path / "report.html"
    answer("report", copied.parent / "drawn", "--out", page)
    assert "dashed: the worst flight found in the tube" in page.read_text()


def altered(table, name, values):
    return table.set_column(table.schema.get_field_index(name), name, pa.array(values))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda t: altered(t, "chi_err_low", np.full(len(t), np.nan)), "must be finite"),
        (lambda t: altered(t, "t", t["t"].to_numpy()[::-1]), "`t` must rise"),
        (lambda t: t.slice(0, 5), "`t` must be the [0-9]+ samples of the flight, got 5"),
        (lambda t: t.slice(0, 0), "`t` must rise"),
        (lambda t: altered(t, "gamma_err_high", np.full(len(t), -9.0)), "lower bounds"),
    ],
)
def test_a_tube_whose_bounds_cannot_be_is_not_drawn(flown, tubes, tmp_path, change, why):
    run = flown.runs[0]
    path = tubes.tubes[run.label].file
    written = tmp_path / "tubes" / path.name
    table = change(pq.read_table(path))
    columns = {name: table[name].to_numpy() for name in table.column_names}
    write_sealed(columns, tubes.tubes[run.label].about, written)

    read = tubes_of([run], tmp_path)

    assert read.tubes == {}
    assert "chi_err_low" not in read.runs[0].signals
    (line,) = read.why_not.values()
    assert re.search(why, line)
    assert "\n" not in line


def test_a_tube_that_names_a_worst_flight_must_have_its_errors(flown, tubes, tmp_path):
    run = flown.runs[0]
    tube = tubes.tubes[run.label]
    about = replace(tube.about, worst={"chi": 1.0, "gamma": 1.0})
    write_sealed(tube.bounds.columns, about, tmp_path / "tubes" / "0.parquet")

    (why,) = tubes_of([run], tmp_path).why_not.values()

    assert "`worst` must come with chi_err_worst and gamma_err_worst" in why


def test_a_worst_flight_of_an_earlier_version_is_passed_over_and_text_for_json_refused(tmp_path):
    (tmp_path / "tubes").mkdir()
    (tmp_path / "tubes" / "0-worst.parquet").write_bytes(b"of an earlier version")
    assert tubes_of([], tmp_path).why_not == {}

    schema = pa.schema([("t", pa.float64())], metadata={ABOUT: "no JSON", SEAL: BLANK})
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table([[0.0]], schema=schema), sink)
    (tmp_path / "tubes" / "0.parquet").write_bytes(seal(sink.getvalue().to_pybytes()))
    (why,) = tubes_of([], tmp_path).why_not.values()
    assert "must be a Parquet file of a tube, got: " in why


def test_a_damaged_tube_is_not_drawn_but_made_again_where_asked(flown, tubes, tmp_path):
    run = flown.runs[0]
    whole = tubes.tubes[run.label].file.read_bytes()
    path = tmp_path / "tubes" / tubes.tubes[run.label].file.name
    path.parent.mkdir()
    for at in (0.1, 0.6, 0.99):
        data = bytearray(whole)
        data[int(at * len(data))] ^= 1
        path.write_bytes(data)

        read = tubes_of([run], tmp_path)

        assert read.tubes == {}
        assert "must be a Parquet file of a tube" in read.why_not[str(path)]
    assert tubes_of([run], tmp_path, make=True).why_not == {}


def test_flights_drawn_as_counted_are_inside_the_tube_that_says_they_are(tmp_path):
    """Counted on starts within 0.5 deg; 30 more of them are flown and compared with the tube."""
    file = tmp_path / "turn.toml"
    scenario = flight(duration_s=1.5)
    file.write_text(toml_text({**scenario.as_dict(), "gains": ["paper"], "expect": []}))
    plan = planned(str(file), kind="jsbsim", start_deg=0.5, draws=60)
    settings = ConformSettings(epsilon=0.1, confidence=0.9)
    with flown_here(conform_module, "planned", plan) as pool:
        counts = conform("turn", settings, pool)
    (run,) = fly(load_scenario(file)).runs

    tubes = tubes_of([run], tmp_path, make=True, conformance=counts)

    (glance,) = tubes.at_a_glance
    bounds = tubes.runs[0].signals[list(TUBE_SIGNALS)].to_numpy()
    fresh = plan.with_runs(1030)  # draws from 1000 on: none was learned from or counted

    def outside(draw, bounds):
        (flown,) = fly(fresh.scenario_of(draw)).runs
        errors = np.repeat(flown.signals[["chi_err", "gamma_err"]].to_numpy(), 2, axis=1)
        return bool(((errors - bounds) * [1.0, -1.0, 1.0, -1.0] < 0.0).any())

    assert not any(outside(draw, bounds) for draw in range(1000, 1030))
    assert tubes.tubes[run.label].about.start_deg == pytest.approx(0.5)
    assert "a flight of the distribution counted leaves the tube with probability" in glance
    exact = tube(load_scenario(file), PAPER_GAINS, conformance=counts)
    assert exact.probability.of == "residual_rates"
    assert outside(1000, exact.bounds.pairs[:, :2].reshape(-1, 4))


def test_commands_make_them_and_say_how_where_there_are_none(tmp_path):
    scenario = tmp_path / "short.toml"
    scenario.write_text(
        'title = "short"\ngains = ["paper"]\n[flight]\nV_a_mps = 25.0\nduration_s = 1.0\n'
        '[reference]\nchi_deg = 1.0\ngamma_deg = 0.0\n[[plant]]\nkind = "kinematic"\n'
    )

    out = tmp_path / "runs"
    # Nothing drives a law off its flight without a disturbance: there is nothing to bound.
    assert "--tube" not in flighttune("fly", scenario, "--out", out)[0]
    with scenario.open("a") as file:
        file.write("[disturbance]\nchi_amplitude = 0.001\nchi_omega_rad_s = 1.0\n")
    assert "--tube" in flighttune("fly", scenario, "--out", out)[0]
    page = tmp_path / "report.html"
    assert answer("report", out, "--out", page)["tubes"] == {}
    assert f"flighttune report {out} --tube" in page.read_text()

    made = answer("report", out, "--out", page, "--tube")["tubes"]
    assert made["kinematic / paper"]["inside"] is True
    assert made["kinematic / paper"]["status"] == "bounded"
    assert "its tube is that of" in page.read_text()
    made["kinematic / paper"]["computed"] = False  # the next commands read it
    assert answer("report", out, "--out", page)["tubes"] == made
    assert answer("fly", scenario, "--out", out)["tubes"] == made
