"""What is answered of an aircraft: its steady flights, its lags, its designed steps, its export."""

import re
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.outputs.answers import identification
from flighttune.outputs.exports.export import ExportedSource
from flighttune.outputs.exports.jsbsim_folder import ExportedFlight
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.identification.design import DesignedAircraft, StepResponse
from flighttune.vehicles.identification.identify import AircraftIdentification
from flighttune.vehicles.trims import Trims


def condition(V_a, gamma_deg, throttle=None, reason=""):
    trim = None if throttle is None else {"throttle": throttle}
    return {"V_a_mps": V_a, "gamma_deg": gamma_deg, "trim": trim, "reason": reason}


ROWS = (
    condition(20.0, -5.0, reason="too slow"), condition(20.0, 5.0, reason="too slow"),
    condition(20.0, 0.0, 0.25), condition(20.0, 10.0, reason="no power"),
    condition(25.0, 5.0, 0.5), condition(25.0, -5.0, 0.125), condition(25.0, 0.0, 0.75),
)  # fmt: skip


def test_steady_flights_are_ranges_of_each_airspeed_with_the_reasons_of_the_others():
    trims = Trims(aircraft="x", title="An X", records=ROWS, not_compiled="it has a waypoint")

    said = trims.answer()

    assert said.summary == ["4 of 7 conditions have a steady flight."]
    assert said.failure == ""
    (note,) = said.notes
    assert re.search("JSBSim flies .*: it has a waypoint.*times the processor time.*gradient", note)
    slow, fast = said.tables[0].records
    assert (slow["V_a_mps"], slow["gamma"], slow["throttle"]) == (20.0, "0", "0.25")
    assert slow["reason"] == "-5: too slow; 5: too slow; 10: no power"
    assert (fast["gamma"], fast["throttle"], fast["reason"]) == ("-5 to 5", "0.125 to 0.75", "")
    assert trims.answer(every_condition=True).tables[0].records == ROWS
    one_each = replace(trims, records=ROWS[3:5], not_compiled="")
    assert one_each.answer().tables[0].records == ROWS[3:5]
    assert one_each.answer().notes == ["Long flights are compiled."]
    none = replace(trims, records=(ROWS[0], ROWS[3])).answer()
    assert none.failure == "x: no steady flight among 2: too slow"
    assert none.summary == ["0 of 2 conditions have a steady flight."]


@pytest.mark.parametrize(("fit", "said"), [(90.0, ""), (89.94, "n_z at 25 m/s, 5 deg: 89.9 %")])
def test_a_lag_that_explains_less_than_nine_tenths_is_a_failure(fit, said):
    known = ft.loop.load_identified("aerosonde")
    first = known.conditions[0]
    n_z = first.channels["n_z"].model_copy(update={"fit_percent": fit})
    phi = first.channels["phi"].model_copy(update={"fit_percent": 95.0})
    place = {"channels": {"phi": phi, "n_z": n_z}, "V_a": 25.0, "gamma": np.radians(5.0)}
    poor = first.model_copy(update=place)
    made = AircraftIdentification(
        identified=known.model_copy(update={"conditions": (poor,)}), conditions=(),
        skipped=("it stalls",), modes=(), folder=None,
    )  # fmt: skip

    answer = made.answer()

    assert answer.failure == (f"aerosonde: a lag explains less than 90 % of {said}" if said else "")
    assert f"explain at least {fit:.1f} % of the variance" in answer.summary[0]
    assert answer.notes[1:] == ["left out: it stalls"]
    roll, lift = answer.tables[0].records
    assert [roll["gamma_deg"], roll["V_a_mps"]] == pytest.approx([5.0, 25.0])
    assert [x["channel"] for x in (roll, lift)] == ["phi", "n_z"]
    assert [x["fit_percent"] for x in (roll, lift)] == [95.0, fit]


def test_a_response_is_in_decibel_and_its_phase_unwrapped_in_degrees():
    """An integrator of three has ``1 / (j w)^3``: -60 dB a decade, and a phase of -270 deg."""
    response = 1.0 / (1j * np.array([0.1, 1.0, 10.0])) ** 3

    assert identification.decibel(response) == pytest.approx([60.0, 0.0, -60.0], abs=1e-9)
    turned = identification.phase_deg(np.exp(-1j * np.array([3.0, 4.0, 5.0])))
    assert turned == pytest.approx(np.degrees([-3.0, -4.0, -5.0]))
    assert identification.decibel(np.zeros(1)) == pytest.approx([-120.0])


def test_a_design_counts_the_steps_that_meet_their_requirements():
    t = 0.1 * np.arange(11)
    rise = np.minimum(t / 0.5, 1.1)  # 90 % after 0.45 s, and a tenth above
    step = StepResponse(
        channel="phi", V_a=20.0, size=0.5, signals={"t": t, "phi": 0.5 * rise}, ended="",
        t90_allowed=0.6, overshoot_allowed=0.2,
    )  # fmt: skip
    slow = replace(step, V_a=25.0, t90_allowed=0.4)
    config = load_aircraft("aerosonde")
    made = DesignedAircraft(config=config, steps=(step, slow, step), before={"roll_kp": 1.5})

    said = made.answer()

    assert said.summary == ["2 of 3 step responses meet their requirements."]
    assert "t90 must be at most 0.4 s and the overshoot 20 %, got 0.50 s and 10.0 %" in said.failure
    gains, steps = said.tables
    assert {row["gain"]: row["designed"] for row in gains.records} == dict(config.gains.gains)
    first, second, _ = steps.records
    assert [first[x] for x in ("t90_s", "t90_allowed_s", "V_a_mps", "step", "met")] == [
        0.5, 0.6, 20.0, 0.5, True,
    ]  # fmt: skip
    assert (first["overshoot"], first["overshoot_allowed"]) == (pytest.approx(0.1), 0.2)
    assert (second["met"], second["t90_allowed_s"]) == (False, 0.4)


@pytest.mark.parametrize("same", [True, False])
def test_an_exported_flight_that_is_not_that_of_fly_is_a_failure(same, tmp_path):
    made = ExportedFlight(
        folder=tmp_path, command="jsbsim --root=x", start=42.5, same=same, notes=("a note",),
        differences={"chi": 1e-12, "V_a": 2e-12}, verdict="It was flown.",
    )  # fmt: skip

    said = made.answer()

    assert said.failure == ("" if same else f"{tmp_path}: It was flown. The folder is kept.")
    assert list(said.summary) == (["It was flown."] if same else [])
    assert said.values["differences"] == {"chi_rad": 1e-12, "V_a_mps": 2e-12}
    assert said.values["start_s"] == 42.5
    assert said.values["csv"] == tmp_path / "flight.csv"
    assert said.notes[0] == "a note"
    assert said.notes[1].endswith("where the flight begins at Time = 42.5 s:")
    assert said.command == "jsbsim --root=x"
    assert said.files["script"] == tmp_path / "flight.xml"


def test_a_law_in_c_is_answered_with_its_file_and_that_of_a_monitor(tmp_path):
    source = tmp_path / "ft_outer_loop.c"

    plain = ExportedSource(source=source, notes=("a note",)).answer()
    both = ExportedSource(source=source, monitor=tmp_path / "ft_monitor.c").answer()

    assert plain.files == {"folder": tmp_path, "source": source}
    assert both.files == {**plain.files, "monitor": tmp_path / "ft_monitor.c"}
    assert plain.notes == ("a note",)
