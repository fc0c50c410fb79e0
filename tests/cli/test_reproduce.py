"""`flighttune reproduce` as a process."""

import json
import subprocess
import sys


def reproduce(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "flighttune", "reproduce", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_an_item_alone_is_answered_with_its_values_and_all_claims(tmp_path):
    done = reproduce("table2", "--out", tmp_path, "--json")

    answer = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert [item["name"] for item in answer["items"]] == ["table2"]
    assert answer["items"][0]["values"]["K1"].keys() == {"R_K", "I_K"}
    verdicts = {claim["id"]: claim["verdict"] for claim in answer["claims"]}
    assert verdicts["peak-time"] == "not reproduced"
    assert (tmp_path / "index.html").is_file()


def test_an_unknown_item_is_refused_in_one_line_that_names_the_known_ones(tmp_path):
    done = reproduce("fig1", "--out", tmp_path)

    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "fig3, gains, fig6" in done.stderr
    assert not list(tmp_path.iterdir())
