"""A command prints with --json the answer of the value that the verb of its name returns.

Those of `reproduce` and `adopt`, which take longer, are in tests/paper and tests/adoption; `new`
and `view` have no answer beyond a file.
"""

import json
from pathlib import Path

import pytest
from commands import answer
from flown_campaigns import flown_here, write_campaign
from fuzzing import marked
from plans import item, plan_file, waypoint

import flighttune as ft
from flighttune.campaigns.engine.engine import forecast
from flighttune.cli.options import COMMANDS

pytestmark = pytest.mark.slow

SHORT = {"flight.duration_s": 1.0}
SET = "--set", "flight.duration_s=1.0"
TURNING = {"flight.duration_s": 2.5}
IDENTIFIED = {"tuning.model": "identified"}
FEW = {"start_deg": 2.0, "plant": "kinematic", "epsilon": 0.5, "confidence": 0.9, "learn": 10}
MONITORED = FEW | {"learn": 20, "plant": "jsbsim:aerosonde"}
TURN = {"flight.duration_s": 4.0}
LONG = "tune --prove", "tune --envelope"
OTHERS = "adopt", "list", "new", "open", "reproduce", "view"

# Which files were written, and what the clock or the folder decides.
OF_THE_COMMAND = {
    *("proof", "written", "figure", "recording", "page", "folder", "source", "model", "route"),
    *("csv", "scenario", "wall_s", "out", "core_s", "timed_runs", "groups"),
    *("rows_bytes", "signals_bytes", "band", "monitor"),
}


def recorded():
    """The folder of a flight."""
    ft.record(ft.fly("paper_as_printed"), "run")
    return "run"


def verified():
    ft.certify("paper", "paper").certificate.save("certificate.json")
    return ft.verify("certificate.json")


def short_mission():
    """A plan of 170 m to the north."""
    takeoff = item(22, 15, 0, 0, None, 47.4, 8.5, 60)
    return plan_file(Path("m.plan"), takeoff, waypoint(47.4015, 8.5, 60))


def planned():
    return forecast(ft.plan_campaign(ft.load_campaign(write_campaign("."))), 1)


def options(settings):
    """The options of the command for the settings of its verb."""
    return [f"--{key.replace('_', '-')}={value}" for key, value in settings.items()]


QUICK = "identify", "trim", "tune --frontier", "campaign"

VERBS = {
    "campaign": (planned, ["campaign.toml", "--dry-run", "--workers", 1]),
    "tune": (lambda: ft.tune("paper"), ["paper"]),
    "tune --prove": (lambda: ft.tune("paper", prove=True), ["paper", "--prove", "bound.json"]),
    "tune --envelope": (
        lambda: ft.tune("paper_identified", envelope=True, changes=IDENTIFIED),
        ["paper_identified", "--envelope", "--set", "tuning.model=identified"],
    ),
    "tune --frontier": (
        lambda: ft.frontier("paper", points=3),
        ["paper", "--frontier", "--points", 3],
    ),
    "certify": (lambda: ft.certify("paper", "K1"), ["paper", "--gains", "K1"]),
    "gradient": (
        lambda: ft.gradient("exact_law", by=["K_P.phi.chi"], measures=["chi.ITAE"]),
        ["exact_law", "--by", "K_P.phi.chi", "--measure", "chi.ITAE"],
    ),
    "verify": (verified, ["certificate.json"]),
    "fly": (lambda: ft.fly("paper", changes=SHORT), ["paper", *SET]),
    "mission --plan": (lambda: ft.route("circuit"), ["circuit", "--plan"]),
    "mission": (
        lambda: ft.mission(short_mission(), epsilon=0.5, confidence=0.9, flights=4),
        ["m.plan", "--epsilon", 0.5, "--confidence", 0.9, "--flights", 4],
    ),
    "verify run": (lambda: ft.refly(recorded()), []),
    "worst": (
        lambda: ft.worst("first_campaign", budget=32, metric="chi.ITAE", plant="kinematic"),
        ["first_campaign", "--budget", 32, "--metric", "chi.ITAE", "--plant", "kinematic"],
    ),
    "meet": (
        lambda: ft.meet("paper_identified", start="paper", budget=2, changes=SHORT),
        ["paper_identified", "--start", "paper", "--budget", 2, *SET],
    ),
    "report": (lambda: ft.report("paper_as_printed@K1"), ["paper_as_printed@K1"]),
    "compare": (lambda: ft.compare("paper@paper", "paper@K1"), ["paper@paper", "paper@K1"]),
    "trim": (lambda: ft.trim("aerosonde", V_a=[25.0]), ["aerosonde", "--V-a", 25]),
    "design": (lambda: ft.design("aerosonde"), ["aerosonde", "--dry-run"]),
    "identify": (
        lambda: ft.identify("aerosonde", V_a=[25.0], gamma=[0.0]),
        ["aerosonde", "--V-a", 25, "--gamma", 0],
    ),
    "tube": (
        lambda: ft.tube("level_turn", "paper", changes=TURNING),
        ["level_turn", "--gains", "paper", "--set", "flight.duration_s=2.5"],
    ),
    "band": (
        lambda: ft.band("level_turn", changes=TURN, **FEW),
        ["level_turn", "--set", "flight.duration_s=4.0", *options(FEW)],
    ),
    "monitor": (
        lambda: ft.monitor("level_turn", changes=TURN, **MONITORED),
        ["level_turn", "--set", "flight.duration_s=4.0", *options(MONITORED)],
    ),
    "gap": (lambda: ft.gap("paper", "paper", changes=SHORT), ["paper", "--gains", "paper", *SET]),
    "export": (
        lambda: ft.export("paper", "paper", out="loop", form="c"),
        ["paper", "--gains", "paper", "--format", "c"],
    ),
}


def of_the_value(found):
    """The answer without what belongs to the command, such as where it wrote files."""
    kept = {key: value for key, value in found.items() if key not in OF_THE_COMMAND}
    if "notes" in kept:  # some name a file for the next command, or one of its options
        of_command = ": flighttune ", "`--"
        kept["notes"] = [x for x in kept["notes"] if not any(y in x for y in of_command)]
    for runs in (kept.get("ladder"), kept.get("runs")):
        for run in runs if isinstance(runs, list) else ():
            run.pop("signals", None)
    return kept


@pytest.mark.parametrize(
    "verb",
    [
        *marked([verb for verb in VERBS if verb not in LONG], pytest.mark.soak, but=QUICK),
        *(pytest.param(verb, marks=pytest.mark.counts) for verb in LONG),
    ],
)
def test_a_command_prints_the_answer_of_its_verb(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, arguments = VERBS[verb]

    with flown_here():
        value = call()
        printed = answer(
            *verb.partition(" --")[0].split(),
            *arguments,
            status=value.answer().status if value.answer().failure else 0,
        )

    assert of_the_value(printed) == of_the_value(json.loads(value.answer().json()))
    assert value._repr_html_() == value.answer().html()


def test_every_command_with_an_answer_is_tried():
    named = {name for commands in COMMANDS.values() for name in commands}

    assert {verb.partition(" ")[0] for verb in VERBS} == named - {*OTHERS} | {"campaign"}


@pytest.mark.soak
def test_a_result_prints_what_its_answer_says():
    certified = ft.certify("paper", "tuned")

    assert str(certified) == "\n".join(certified.answer().text(100))
    assert str(certified).startswith("Proven: errors shrink as ")
    assert certified.answer().values["sentence"].startswith("for the linear model, whose")


def test_a_result_saves_its_answer_whose_gains_are_read(tmp_path):
    certified = ft.certify("paper", "paper")

    certified.save(tmp_path / "own.json")

    assert (tmp_path / "own.json").read_text() == certified.answer().json() + "\n"
    assert ft.load_gains(tmp_path / "own.json").K.tolist() == ft.PAPER_GAINS.K.tolist()


@pytest.mark.soak
def test_a_proof_that_is_asked_for_is_written_and_verified(tmp_path):
    said = answer("tune", "paper", "--prove", tmp_path / "bound.json")

    verified = ft.verify(tmp_path / "bound.json")
    assert verified.valid
    assert said["proof"] == str(tmp_path / "bound.json")
