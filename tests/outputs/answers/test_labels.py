"""Names of metrics and of keys as text."""

import math
import re
from pathlib import Path

import pytest
from places import ROOT

import flighttune
from flighttune.base.names import key_words
from flighttune.base.words import at_least, at_most, confidence_text
from flighttune.campaigns.planning.schema import MEASURES
from flighttune.flight import metrics
from flighttune.outputs.answers import labels


def test_every_label_of_a_single_table_is_one_of_its_columns():
    code = "".join(path.read_text() for path in Path(flighttune.__file__).parent.rglob("*.py"))
    used = {name: set() for name in labels.TABLES["tables"]}
    for keys, name in re.findall(r'columns\w*\(\s*((?:"[^"]*"\s*)+),\s*of="(\w+)"', code):
        used[name] |= set(keys.replace('"', " ").split())
    for name, headings in labels.TABLES["tables"].items():
        assert headings.keys() <= used[name]


def test_the_page_of_campaigns_has_every_measure():
    page = (ROOT / "docs/campaigns.md").read_text(encoding="utf-8")

    named = {name.rpartition(".")[2] for name in re.findall(r"`([\w.]+)`", page)}
    assert {name.rpartition(".")[2] for name in MEASURES} <= named


def test_every_metric_has_a_label_and_angles_are_in_degrees():
    named = {
        *metrics.METRICS,
        *metrics.FLIGHT_METRICS,
        *metrics.AIRSPEED_METRICS,
        "peak_rad",
        "end_error_rad",
        "end_error_mps",
        "error",
    }
    named |= {*metrics.LOOP_METRICS} - labels.QUANTITIES.keys()
    assert named == labels.METRIC_LABELS.keys()
    assert labels.metric_label("V.MO_mps").heading == "overshoot of V [m/s]"
    assert labels.metric_label("chi.MO_rad").heading == "overshoot of χ [deg]"
    assert labels.metric_label("chi.MO_rad").written(math.pi / 18.0) == "10.00"
    assert labels.metric_label("gamma.effort_rms").heading == "effort rms of γ [1]"
    assert labels.metric_label("flight.n_z_max").heading == "maximum n_z [1]"
    assert labels.metric_label("chi.MO_deg").written(10.0) == "10.00"
    assert labels.measure_words("chi.MO_deg") == "overshoot of course"
    assert labels.measure_words("gamma.settling_s") == "settling time of path angle (5\u00a0%)"
    assert labels.measure_words("V.settling_s within 0.5 deg") == (
        "settling time of airspeed (within 0.5 deg)"
    )
    assert labels.measure_words("height_err.error within 9 m, 2 m from 4 s") == (
        "largest error over envelope of height (within 9 m, 2 m from 4 s)"
    )
    assert labels.metric_label("loop.phase_margin_deg").heading == "phase margin [deg]"


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("flight.chi_deg", "initial course"),
        ("plant.airframe.actuator_lag_factor", "actuator lag"),
        ("limits.n_z[1]", "maximum limit of load factor"),
        ("reference.chi_deg[1].start_s", "reference course 2 start"),
        ("plant[jsbsim:x.8].airframe.ixx_factor", "roll inertia of jsbsim:x.8"),
    ],
)
def test_a_dispersed_quantity_is_said_in_words(key, words):
    assert key_words(key) == words


@pytest.mark.parametrize(
    ("value", "digits", "below", "above"),
    # 0.05 and 0.1 are printed as they were stated, though their doubles are a little above.
    [
        (0.046192420328, 4, "0.04619", "0.0462"),
        (0.05, 4, "0.05", "0.05"),
        (0.1, 2, "0.1", "0.1"),
        (0.0831, 2, "0.083", "0.084"),
        (12.1, 2, "12", "13"),
        (9.999, 2, "9.9", "10"),
        (-0.12345, 3, "-0.124", "-0.123"),
        (0.0, 2, "0", "0"),
        (math.inf, 3, "∞", "∞"),
    ],
)
def test_a_bound_in_few_digits_is_on_its_side(value, digits, below, above):
    assert (at_least(value, digits), at_most(value, digits)) == (below, above)


@pytest.mark.parametrize(
    ("confidence", "shown"),
    [
        (0.95, "0.95"),
        (0.999, "0.999"),
        (1.0 - 0.1 / 3.0, "0.966"),
        (1.0 - 0.2 / 3.0, "0.933"),
        (1.0 - 0.001 / 3.0, "0.99966"),
        (1.0, "1"),
    ],
)
def test_a_confidence_has_two_digits_of_what_it_leaves_open(confidence, shown):
    assert confidence_text(confidence) == shown


def test_a_requirement_in_words_has_all_its_values_in_the_unit_shown():
    shown = labels.in_words(
        {"measure": "chi.peak_rad", "bound": math.pi, "value": 0.5 * math.pi, "start": math.inf}
    )

    assert (shown["words"], shown["unit"]) == ("peak error of course", "deg")
    assert shown["bound"] == pytest.approx(180.0)
    assert shown["value"] == pytest.approx(90.0)
    assert shown["start"] == math.inf


@pytest.mark.parametrize(
    ("deg", "text"),
    [(0.0, "0"), (9e-06, "< 0.0001"), (1e-4, "0.0001"), (0.14321, "0.1432"), (math.nan, "–")],
)
def test_a_half_width_has_no_digits_that_nobody_needs(deg, text):
    (column,) = labels.columns("end", of="tube")

    assert column.text({"end": deg}) == text


def test_a_measure_of_the_airspeed_is_in_metres_per_second():
    """The integral of ``t |e|`` of an angle is in rad s², of an airspeed in m/s s²."""
    angle, speed = (labels.metric_label(f"{x}.ITAE", {x: x}) for x in ("chi", "V"))

    assert angle.unit.startswith("rad")
    assert speed.unit == angle.unit.replace("rad", "m/s")
    assert speed.factor == 1.0


def test_a_column_of_a_channel_has_its_symbol_and_the_unit_of_its_measure():
    (column,) = labels.columns("metrics.chi.MO_rad")

    assert column.name.endswith(" χ")
    assert column.unit == "deg"
    assert float(column.text({"metrics": {"chi": {"MO_rad": 0.1}}})) == pytest.approx(
        5.73, abs=5e-3
    )
    (plain,) = labels.columns("metrics.all.MO_rad")
    assert (plain.key, plain.unit) == ("metrics.all.MO_rad", "deg")
    assert "χ" not in plain.name
