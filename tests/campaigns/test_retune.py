"""An autopilot's parameters searched by flights, and written only if they are better."""

import pytest
from commands import flighttune


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["circuit_in_wind", "--with", "plane.param", "--out", "x.json"], ".params or .param"),
        (["circuit_in_wind", "--with", "plane.param", "--out", "x.params"], ".param or .parm"),
        (["circuit_in_wind", "--with", "plane.param", "--out", "plane.param"], "another file than"),
        (["circuit_in_wind", "--with", "plane.param", "--success", "0.9"], "must be absent with"),
        (["circuit", "--flights", "5"], "`flights` must be absent without the parameters"),
        (["level_turn", "--with", "plane.param"], "must be a route"),
        (["circuit_in_wind", "--with", "plane.param", "--budget", "9"], "at least 300 flights"),
        (["circuit_in_wind", "--with", "other.param"], "must state one of NAVL1_PERIOD"),
        (
            ["circuit_in_wind", "--with", "plane.param", "--assume", "n_z=4"],
            "`assume` must be absent without the log of an aircraft",
        ),
    ],
)
def test_what_cannot_be_searched_is_refused_in_a_line(tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plane.param").write_text("NAVL1_PERIOD,14\nROLL_LIMIT_DEG,45\n")
    (tmp_path / "other.param").write_text("TECS_SPDWEIGHT,1\nROLL_LIMIT_DEG,45\n")
    assert words in " ".join(flighttune("meet", *options, status=2)[1].split())
