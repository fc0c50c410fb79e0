"""Charts of claims and of runs show both errors in degrees, and pages of logs say their alarms."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.flight.loop.run import Bounds
from flighttune.gaps import compare
from flighttune.outputs.pages import page
from flighttune.outputs.pages.tube import tube_charts

T = 0.1 * np.arange(31)


def test_a_tube_is_drawn_between_its_bounds_in_degrees():
    low = np.column_stack([-0.1 - 0.01 * T, 5.0 + T, -0.2 + 0.0 * T])
    high = np.column_stack([0.3 + 0.02 * T, 6.0 + T, 0.4 + 0.0 * T])
    bounds = Bounds(T, low, high, ("gamma_err", "V_a", "chi_err"))

    course, path_angle = tube_charts(SimpleNamespace(bounds=bounds))

    for chart, title, i in ((course, "Course error", 2), (path_angle, "Path-angle error", 0)):
        assert chart.title == title
        assert chart.x_range == (0.0, pytest.approx(3.0))
        (_, zero), *curves = chart._seen
        assert zero.tolist() == [0.0]
        for (x, y), wanted in zip(curves, (low, high) * 2, strict=True):
            assert x == pytest.approx(T)
            assert y == pytest.approx(np.degrees(wanted[:, i]))
        assert [name for name, *_ in chart.legend] == ["tube"]


def test_a_plot_of_runs_has_their_errors_and_angles_with_those_that_flew_in_the_legend():
    names = ("chi_err", "gamma_err", "phi", "n_z")
    flown, other, none = (
        made_up_run(dict.fromkeys(names, 0.1 * T[:n]), T[:n], gains_name=gains)
        for n, gains in ((31, "paper"), (11, "K1"), (1, "K2"))
    )

    charts = ft.plot([flown, other, none]).charts

    assert [chart.title for chart in charts] == [
        "Course error", "Path-angle error", "Roll", "Load factor"
    ]  # fmt: skip
    for chart, factor in zip(charts, [*np.degrees([1.0] * 3), 1.0], strict=True):
        first, second = (y for _, y in chart._seen if len(y) > 1)
        assert (first[-1], second[-1]) == pytest.approx((0.3 * factor, 0.1 * factor))
        assert [name for name, *_ in chart.legend] == [flown.label, other.label]
    with pytest.raises(ft.InputError, match="must have a run that flew"):
        ft.plot(none)


class Told(NamedTuple):
    """An alarm of a monitor."""

    sentence: str


@pytest.mark.parametrize(
    ("monitors", "status", "failure"),
    [
        ([("", None), ("", None)], 0, ""),
        ([("", None), ("", Told("an alarm at 2 s"))], 1, "an alarm at 2 s"),
        ([("another law", None)], 2, "no claim about this flight: another law."),
        ([("another law", None), ("", Told("an alarm at 2 s"))], 1, "an alarm at 2 s"),
        ([("", Told("an alarm at 2 s")), ("", Told("a later one"))], 1, "an alarm at 2 s"),
    ],
)
def test_the_page_of_a_log_is_a_failure_if_a_monitor_alarms_or_none_is_about_it(
    monitors, status, failure, tmp_path, monkeypatch
):
    lines = ["t_s,phi_deg,V_a_mps", *(f"{0.1 * k},{k % 7},{25 + k % 2}" for k in range(50))]
    (tmp_path / "flight.csv").write_text("\n".join(lines))
    source = compare.load_source(str(tmp_path / "flight.csv"))
    score = np.linspace(0.0, 0.5, len(source.runs[0].t) - 10)
    monkeypatch.setattr(page, "score_so_far", lambda *_: score)
    watching = [
        SimpleNamespace(
            watches=[SimpleNamespace(from_s=1.0)], sentence="it is one",
            not_about=lambda _, why=why: why, alarm=lambda _, alarm=alarm: alarm,
        )
        for why, alarm in monitors
    ]  # fmt: skip

    written = page.write_log_page(source, tmp_path / "page.html", watching)

    shown = written.shown
    assert shown.failure.endswith(failure)
    assert bool(shown.failure) == bool(failure)
    assert (shown.status if shown.failure else 0) == status
    quiet = sum(not why and alarm is None for why, alarm in monitors)
    assert sum(x.startswith("No alarm from 1 s on") for x in written.summary) == quiet
    assert [alarm is not None for alarm in shown.values["alarms"]] == [
        alarm is not None for _, alarm in monitors
    ]
