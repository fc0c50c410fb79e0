"""What the commands of campaigns cannot use is refused in one line that says what it must be."""

import pytest
from commands import flighttune

CASES = {
    "band": [
        (("random_starts", "--epsilon", "0"), "`epsilon` must be between"),
        (("random_starts", "--of", "residual", "--air", "severe"), "`air` must be one of calm"),
        (("feasible",), "feasible: `start_deg` must be given for a scenario in"),
        (("feasible", "--start-deg", "-2"), "`start_deg` must not be negative"),
        (("aerosonde",), "aerosonde"),
        (("random_starts", "--flights", "600"), "`flights` must be at least 688"),
        (("feasible_starts", "--start-deg", "2"), "are for scenarios"),
        (("kinematic_sweep", "--of", "residual"), "`plant` must be an aircraft"),
    ],
    "worst": [
        (("paper",), "`disperse` must name a key"),
        (("paper", "--start-deg", "-1"), "`start_deg` must not be negative"),
        (("first_campaign", "--disturbance", "0.1"), "are for scenarios"),
        (("first_campaign", "--metric", "chi.NONE"), "`metric` must be margin or one of"),
        (("first_campaign", "--budget", "3"), "`budget` must be at least"),
        (("first_campaign", "--gains", "K9"), "`gains` must be one of"),
        (("first_campaign", "--out", "x.json"), "x.json: --out must end in .toml"),
    ],
    "tune": [
        (("paper", "--out", "gains.txt"), "gains.txt: --out must end in .json"),
    ],
    "meet": [
        (("paper", "--page", "page.pdf"), "page.pdf: --page must end in .html"),
        (("gust_in_turn",), "[[expect]] must bound a measure"),
    ],
}


@pytest.mark.parametrize(
    ("command", "arguments", "message"),
    [(command, *case) for command, cases in CASES.items() for case in cases],
)
def test_bad_input_is_one_line(command, arguments, message, tmp_path):
    out, err = flighttune(*command.split(), *arguments, status=2, cwd=tmp_path)

    assert message in err
    assert not out
    assert err.count("\n") == 1
