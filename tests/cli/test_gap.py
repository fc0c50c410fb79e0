"""``flighttune gap`` as a user meets it."""

from pathlib import Path

import pytest
from commands import answer, flighttune

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return answer("gap", "paper", "--out", tmp_path_factory.mktemp("gap"))


@pytest.mark.soak
def test_the_cause_is_the_step_that_the_chart_of_itae_shows_as_the_largest(found):
    for channel, name in (("chi", "Course"), ("gamma", "Path angle")):
        first, *_, last = (rung["metrics"][channel]["ITAE"] for rung in found["ladder"])
        steps = {step["adds"]: step["metrics"][channel]["ITAE"] for step in found["contributions"]}
        largest = max(steps, key=lambda adds: abs(steps[adds]))
        assert found["cause"][channel] == {"adds": largest, "ITAE": steps[largest]}
        (said,) = (note for note in found["summary"] if note.startswith(name))
        for part in (f"{first:.2f} rad s²", f"{last:.2f} on", f"{steps[largest]:+.2f} ({largest})"):
            assert part in said
        assert said in Path(found["page"]).read_text(encoding="utf-8").replace("&#39;", "'")
    assert "rms_rad" not in str(found["contributions"])


@pytest.mark.soak
def test_rungs_that_failed_give_no_metrics_and_no_cell_is_cut(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    path = tmp_path / "wild.toml"
    path.write_text("K_P = [[-1.0, 0.0], [0.0, -1.0]]\nK_I = [[-1.0, 0.0], [0.0, -1.0]]\n")

    out, _ = flighttune("gap", "paper", "--gains", path, "--out", tmp_path, status=1)

    assert "point_mass ended early (left envelope)" in " ".join(out.split())
    assert max(map(len, out.partition("\nNo metrics of")[0].splitlines())) <= 100
