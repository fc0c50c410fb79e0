"""The command line as a user meets it: output, exit status, one line for what went wrong."""

import json
import re
import sys
import tomllib
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import typer
from commands import answer, flighttune
from places import STUDIES

import flighttune as ft
from flighttune.cli import main
from flighttune.cli.app import _reason, app


def test_the_signals_of_a_run_are_where_fly_says(tmp_path):
    flown = answer("fly", "paper_as_printed", "--out", tmp_path)
    assert flown["recording"] == str(tmp_path / "paper_as_printed.rrd")
    for run in flown["runs"]:
        (stored,) = ft.load(run["signals"]).runs
        error, t = stored.signals["chi_err"].to_numpy(), stored.signals.index.to_numpy()
        itae = np.sum(np.diff(t) * 0.5 * ((t * abs(error))[1:] + (t * abs(error))[:-1]))
        assert run["metrics"]["chi"]["ITAE"] == pytest.approx(itae, rel=1e-9)
        assert f"{stored.provenance.plant} / {stored.provenance.gains_name}" == stored.label


def test_a_run_that_ends_early_is_a_result_with_a_reason_and_exit_status_one(tmp_path):
    text = (STUDIES / "paper_as_printed.toml").read_text()
    path = tmp_path / "unlimited.toml"
    path.write_text(text.replace("phi_deg = [-45.0, 45.0]\nn_z     = [-2.1, 2.1]", ""))

    out, err = flighttune("fly", path, "--out", tmp_path, "--json", status=1)

    (run,) = json.loads(out)["runs"]
    assert run["status"] == "diverged"
    assert "roll command" in run["reason"]
    assert run["duration_s"] < 20.0
    assert "kinematic / paper: diverged" in err


@pytest.mark.soak
def test_infeasible_gains_are_not_flown_and_say_so(tmp_path):
    text = (STUDIES / "paper_printed_limits.toml").read_text()
    path = tmp_path / "infeasible.toml"
    path.write_text(text.replace('gains    = ["paper"]', 'gains = ["paper", "tuned"]'))

    out, err = flighttune("fly", path, "--out", tmp_path, "--json", status=1)

    runs = json.loads(out)["runs"]
    assert [run["status"] for run in runs] == ["completed", "no_gains"]
    assert pd.read_parquet(runs[1]["signals"]).empty
    assert "no_gains: `I_star` must be at least 67.1" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("fly nowhere.toml", "nowhere.toml: there is no such file: the scenario must be"),
        ("fly first_campaign", "first_campaign is a campaign: `flighttune campaign"),
        ("campaign paper", "paper is a scenario: `flighttune fly paper`"),
        ("fly a4", "a4 is an aircraft: `flighttune trim a4`"),
        ("certify paper --gains=", "`gains` must be one of tuned, paper, K1"),
        ("certify paper --gains gone.json", "gone.json: must be readable, got no such file"),
        ("certify level_turn --envelope", "`envelope` must be given"),
        ("view gone.rrd", "gone.rrd"),
        ("verify none.rrd", "none.rrd: there is no such file."),
        ("report nowhere", "nowhere: there is no such file: the scenario must be"),
        ("report paper -o report.pdf", "report.pdf: --out must end in .html"),
        ("compare paper@K1 paper@K9", "paper.toml: `gains` must be one of tuned, paper, K1"),
        ("compare paper@K1 nowhere.parquet", "nowhere.parquet: there is no such file."),
        ("trim aerosonde --gamma 5 --gamma 120", "`gamma` must lie inside +-90 deg, got 120.0 d"),
        ("trim aerosonde --phi -90", "`phi` must lie inside +-90 deg, got -90.0 deg"),
        ("identify aerosonde --gamma -30", "no steady flight at V_a 25 m/s"),
        ("identify aerosonde --out model.txt", "model.txt: --out must end in .json"),
        ("adopt concorde9 --out x", "Concorde"),
        ("adopt nowhere/x8.xml --out x", "nowhere/x8.xml"),
        ("export speed_change_in_turn --gains exact:speed --format c --out x", "`V_mps` of [ref"),
        ("export crosswind_course --gains paper --out x", "`wind.level` must be absent"),
        ("export oscillating_wind --gains paper --out x", "`disturbance.as_wind` must be absent"),
        ("export paper_as_printed --gains paper --out x", "`plant` must"),
        ("campaign first_campain", "did you mean first_campaign?"),
        (f"certify {__file__}", ".py: must be a scenario (.toml), or a file of another kind"),
        ("reproduce gain", "got gain; did you mean gains?"),
        ("band feasible_starts --start-deg 2", "must be absent for what is no scenario"),
        ("report paper --column a=b", "`--column` must be absent for what is no log"),
        ("worst paper", "`disperse` must name a key"),
        ("worst first_campaign --metric chi.NONE", "`metric` must be margin or one of"),
        ("worst first_campaign --out x.json", "x.json: --out must end in .toml"),
        (
            "mission circuit --plan --out x.gpx",
            "x.gpx: --out must end in .geojson or .kml or .plan",
        ),
        ("adopt 737 --V-a nan", "`V_a` must be positive, got nan"),
        ("adopt 737 --h 0", "`h` must be positive, got 0.0"),
        ("gap paper --out x.html", "x.html: --out must be a folder"),
        ("fly paper --out x.rrd", "x.rrd: --out must be a folder"),
        ("meet paper --page page.pdf", "page.pdf: --page must end in .html"),
        ("meet gust_in_turn", "[[expect]] must bound a measure"),
        ("compare paper paper@tuned", "paper@paper"),
        ("tune paper --nope", "--nope"),
        ("tune paper --nope", "flighttune tune --help"),
        ("fly", "SCENARIO"),
        ("fliy paper", "fliy"),
        ("--workers 0 band paper", "'--workers': it must be at least 1;"),
        ("band paper --workers=0", "'--workers': it must be at least 1;"),
        ("band paper --workers x", "'--workers': it must be an integer;"),
        ("tune paper --points 1001", "'--points': it must be at most 1000;"),
        ("band paper --epsilon x", "'--epsilon': it must be a number;"),
        (
            "campaign first_campaign --scheduler tcp://127.0.0.1:1",
            "tcp://127.0.0.1:1: no scheduler answers there: [Errno 111] Connection refused\n",
        ),
        # of an earlier version
        ("route circuit --out x.kml", "is `flighttune mission circuit --plan` now"),
        ("band m.plan --fence=f.kml", "is `flighttune mission m.plan --fence` now"),
        (
            "band random_starts --of residual",
            "`flighttune tube SCENARIO --boxes random_starts` now",
        ),
        ("band circuit --seed 3", "is `flighttune band circuit --set seed=N` now"),
    ],
)
def test_what_cannot_run_gets_one_line_and_exit_status_two(arguments, message, tmp_path):
    out, err = flighttune(*arguments.split(), status=2, cwd=tmp_path)

    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_debug_shows_the_traceback():
    argv = ["flighttune", "--debug", "fly", "nowhere.toml"]
    with mock.patch.object(sys, "argv", argv), pytest.raises(ft.ScenarioError, match="nowhere"):
        main()


def test_the_version_is_that_of_the_project():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]

    assert flighttune("--version")[0] == f"flighttune {project['version']}\n"


def test_quiet_prints_failures_only():
    assert flighttune("list", "-q") == ("", "")
    assert answer("list", "-q") == answer("list")
    out, err = flighttune("fly", "nowhere", "-q", status=2)
    assert out == ""
    assert "nowhere" in err


COMMANDS = {(name,): x for name, x in typer.main.get_command(app).commands.items()}


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_help_ends_with_an_example_and_fits_80_columns(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown, _ = flighttune(*command, "--help")

    assert shown.splitlines()[-1].startswith(f"  Example: flighttune {' '.join(command)} ") or (
        command == ("list",)
    )
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("command", COMMANDS.values(), ids=lambda x: x.name)
def test_every_option_has_a_help_without_words_of_python(command):
    for parameter in command.params:
        if not parameter.hidden:
            assert parameter.help.endswith((".", "].")), parameter.name
            assert not re.search("``|optional", parameter.help), parameter.name


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("fly pa", {"paper", "paper_as_printed", "paper_identified", "paper_printed_limits"}),
        ("campaign first", {"first_campaign"}),
        ("ca", {"campaign"}),
        (
            "fly paper --gains tuned",
            {"tuned", "tuned_identified", "tuned_fed_back", "tuned_gentle"},
        ),
        ("fly own.toml --gains so", {"soft"}),
        ("trim a", {"a4", "aerosonde"}),
    ],
)
def test_a_shell_completes_commands_and_names(typed, wanted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.toml").write_text('[[gains]]\nname = "soft"')
    words = ["flighttune", *typed.split()]
    monkeypatch.setenv("_FLIGHTTUNE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", " ".join(words))
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))

    assert set(flighttune()[0].split()) == wanted


def test_a_file_that_may_not_be_looked_at_is_one_line(tmp_path, monkeypatch):
    def denied(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("pathlib.Path.is_file", denied)

    printed, said = flighttune("fly", "private/x.toml", status=2, cwd=tmp_path)

    assert (printed, said) == ("", "flighttune: private/x.toml: permission denied.\n")


def test_no_error_steers_the_terminal(tmp_path):
    (tmp_path / "x.toml").write_text('reference = { chi_deg = [{ shape = "\\u001b[2Jx" }] }')

    with pytest.raises(ft.InputError) as refusal:
        ft.load_scenario(tmp_path / "x.toml")

    assert "[2Jx" in str(refusal.value)
    assert str(refusal.value).isprintable()


def test_an_interruption_while_an_error_is_printed_ends_with_130(monkeypatch):
    monkeypatch.setattr("flighttune.cli.app.fail", mock.Mock(side_effect=KeyboardInterrupt))

    flighttune("fly", "nowhere.toml", status=130)


@pytest.mark.soak
@pytest.mark.parametrize(
    "title", ["\x1b[31mred\x07\x9b\u202e\u2028 end", ".", "..", "at 25.5 m/s, etc.", "]]> -- <b>"]
)
def test_a_title_neither_steers_the_terminal_nor_makes_rerun_warn(title, tmp_path, capfd):
    scenario = tmp_path / "turn.toml"
    scenario.write_text(
        f'title = {json.dumps(title)}\ngains = ["paper"]\n'
        "flight = { V_a_mps = 25.0, duration_s = 0.5 }\n"
        "reference = { chi_deg = 10.0, gamma_deg = 0.0 }\n"
        '[[plant]]\nkind = "kinematic"\n'
    )

    printed = [
        *flighttune("fly", scenario, "--out", tmp_path / "run"),
        *flighttune("report", tmp_path / "run", "--out", tmp_path / "page.html"),
    ]

    assert title.strip("\x1b")[-3:] in printed[0]
    assert all(char.isprintable() or char in "\n\u00a0" for text in printed for char in text)
    assert capfd.readouterr() == ("", "")


def test_a_command_has_at_most_about_twelve_options():
    for (name, *_), command in COMMANDS.items():
        options = [p.name for p in command.params if p.param_type_name == "option" and not p.hidden]
        most = {"meet": 17, "mission": 17, "band": 13, "monitor": 13}.get(
            name, 12
        )  # beside what is printed
        assert len({*options} - {"as_json", "quiet"}) <= most, name


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError(36, "File name too long", "x" * 5000), r"x+\.\.\.x+: file name too long\."),
        (ImportError("a.so: failed to map segment"), "a library: .* map segment.* memory"),
        (MemoryError(), "libraries and data must fit into the memory there is"),
    ],
)
def test_what_the_system_refuses_is_no_fault_of_ours(error, line):
    assert re.match(line, _reason(error))
    assert len(_reason(error)) < 300
