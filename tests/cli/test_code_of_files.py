"""Commands run Python code that a file names after a word on stderr, or not at all."""

import hashlib
import importlib.util
import os
import py_compile
import shutil
import textwrap
from contextlib import chdir, nullcontext, suppress
from pathlib import Path

import pytest
from commands import COMMANDS, answer, flighttune
from flown_campaigns import flown_here
from made_up import run_file

import flighttune as ft
from flighttune.base.files import code
from flighttune.campaigns.engine.flyer import Flyer, work_of
from flighttune.campaigns.flying.rows import Draw

LAW = """
    import math
    from pathlib import Path

    with Path(__file__).with_name("ran").open("a") as mark:
        mark.write("x")

    class Mine:
        signals = {}

        def __init__(self, setup):
            self.dt = setup.dt

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            return reference.chi - measured.chi, math.cos(measured.gamma)
"""
SCENARIO = """
    title = "a stranger's"
    gains = ["paper"]
    flight = { V_a_mps = 25.0, duration_s = 0.5 }
    reference = { chi_deg = 10.0, gamma_deg = 0.0 }
    plant = [{ kind = "kinematic" }, { kind = "point_mass" }]
    law = [{ name = "paper", kind = "paper" },
           { name = "mine", kind = "python", module = "law.py", class = "Mine" }]
"""
CAMPAIGN = """
    title = "draws"
    scenario = "scenario.toml"
    runs = 8
    disperse = [{ key = "flight.chi_deg", distribution = "uniform", lower = -5.0, upper = 5.0 }]
"""
NOTICE = "runs the Python code of law.py"
ROUTE = """route.waypoint = [{ north_m = 0.0, east_m = 0.0 }, { north_m = 60.0, east_m = 0.0 }]
    limits = { phi_deg = [-30.0, 30.0], phi_rate_dps = 30.0 }"""
LAW_FILE = 'module = "law.py", class = "Mine"'
SOURCES = {
    "law.py": LAW,
    "scenario.toml": SCENARIO,
    "paper.toml": SCENARIO.partition(',\n           { name = "mine"')[0] + "]\n",
    "with_aircraft.toml": SCENARIO.replace('point_mass"', 'jsbsim", aircraft = "aerosonde"'),
    "scenario_of_route.toml": (
        SCENARIO.replace("duration_s = 0.5", "duration_s = 4.0")
        .replace("reference = { chi_deg = 10.0, gamma_deg = 0.0 }", ROUTE)
        .replace('{ name = "paper", kind = "paper" },', "")
    ),
    "own_plant.toml": SCENARIO.replace(
        'point_mass"', f'python", name = "own", {LAW_FILE}'
    ).partition(',\n           { name = "mine"')[0]
    + "]\n",
    "campaign.toml": CAMPAIGN,
    "campaign_of_route.toml": CAMPAIGN.replace("scenario.toml", "scenario_of_route.toml"),
}
COUNT = "--epsilon 0.5 --confidence 0.5 --flights 2 --learn 10 --workers 1"


def written(folder):
    for name, text in SOURCES.items():
        (folder / name).write_text(textwrap.dedent(text))
    return folder


@pytest.fixture
def folder(tmp_path):
    return written(tmp_path)


# Commands that read a stranger's files: his recording (a folder, a file, a Parquet file), the
# folder of his campaign, his claims, and his scenario where none of his code flies. A verb that
# flies what is stated is in `FLIES` too. The exit status stands before each.
READS = {
    "tune": [
        "0 tune scenario.toml",
        "0 tune scenario.toml --page tuned.html",
        "0 tune own_plant.toml --page tuned.html",
        "2 tune scenario_of_route.toml --page tuned.html",
    ],
    "meet": ["2 meet run", "2 meet band.npz"],
    "certify": ["0 certify scenario.toml --gains paper"],
    "verify": [
        "2 verify run",
        "2 verify run/run.rrd",
        "2 verify mine.parquet",
        "2 verify campaign --count 1",
        "2 verify campaign --run 1",
        "1 verify band.npz --count 1",
        "2 verify band.npz --run 11",
        "1 verify monitor.npz --count 1",
        "0 verify tube.npz",
        "0 verify certificate.json",
    ],
    "fly": ["0 fly scenario.toml --gains paper --claim tube.npz --out over"],
    "mission": [
        "2 mission band.npz",
        "2 mission run",
        "2 mission campaign",
        "0 mission route.npz --page route.html",
        "2 mission route.npz --turn-back 20",
        "0 mission scenario_of_route.toml --plan",
    ],
    "view": [],  # it is a program that is handed the name of the file
    "open": ["2 open band.npz", "2 open tube.npz"],  # others: outputs/live/test_server.py
    "list": ["0 list"],
    "campaign": ["0 campaign campaign.toml --dry-run", "2 campaign run", "2 campaign band.npz"],
    "gap": ["0 gap with_aircraft.toml --gains paper --out gap", "2 gap run", "2 gap band.npz"],
    "gradient": [
        "0 gradient with_aircraft.toml --gains paper --by K_P --measure chi.ITAE",
        "2 gradient with_aircraft.toml --gains mine:paper",
        "2 gradient run",
    ],
    "compare": [
        "0 compare run",
        "0 compare run/run.rrd run@mine:paper",
        "0 compare mine.parquet paper.toml@paper",
        "0 compare run --out run.html",
        "0 compare run --out both.rrd",
        "0 compare scenario.toml@paper scenario.toml@paper",
        "2 compare campaign band.npz",
    ],
    "worst": [
        "2 worst campaign --budget 32 --gains mine:paper",
        "2 worst band.npz --budget 32",
        "0 worst tube.npz --budget 32",
        "2 worst run",
    ],
    "tube": [
        "0 tube scenario.toml --gains paper --set flight.duration_s=0.2",
        "2 tube scenario.toml --gains paper --boxes campaign --set flight.duration_s=0.2",
        "2 tube scenario.toml --gains paper --boxes band.npz",
        "2 tube run",
    ],
    "band": [
        "0 band band.npz",
        "2 band band.npz --flights 8",
        "2 band campaign --gains mine:paper",
        "2 band run",
    ],
    "monitor": ["2 monitor campaign --gains mine:paper", "2 monitor run", "2 monitor band.npz"],
    "report": [
        "0 report run",
        "0 report run/run.rrd",
        "0 report mine.parquet",
        "0 report campaign",
        "0 report band.npz",
        "0 report monitor.npz",
        "0 report tube.npz",
        "0 report certificate.json",
        "0 report scenario.toml@paper",
    ],
    "export": [
        "0 export with_aircraft.toml --gains paper --out exported",
        "0 export scenario.toml --gains paper --format c --out c",
        "2 export scenario.toml --gains mine:paper --out not",
        "2 export run --out not",
        "2 export band.npz --out not",
    ],
    **dict.fromkeys(("new", "adopt", "trim", "design", "identify", "reproduce"), ()),
}

# Commands that fly what is stated by name, and run its code after the word.
FLIES = {
    "certify": ["1 certify scenario.toml --gains mine:paper"],
    "fly": ["0 fly scenario.toml -q", "0 fly scenario.toml --json"],
    "gap": ["2 gap with_aircraft.toml --gains mine:paper"],
    "report": ["0 report scenario.toml@mine:paper"],
    "compare": ["0 compare scenario.toml@paper scenario.toml@mine:paper"],
    "campaign": ["0 campaign campaign.toml --out flown --workers 1"],
    "worst": ["0 worst campaign.toml --gains mine:paper --budget 32 --workers 1"],
    "band": [f"0 band campaign.toml --gains mine:paper {COUNT}"],
    "monitor": [f"0 monitor campaign.toml --gains mine:paper {COUNT} --learn 20"],
    "mission": [
        "0 mission campaign_of_route.toml --epsilon 0.5 --confidence 0.5 --flights 2 --workers 1"
    ],
}

# Commands that run the code that a file of flighttune's names, if they have --run-code.
WITH_RUN_CODE = [
    "0 verify run --run-code",
    "0 verify mine.parquet --run-code",
    "0 verify campaign --run 1 --run-code",
    "0 verify band.npz --count 1 --run-code",
    "0 verify band.npz --run 11 --run-code",
    "0 band band.npz --flights 8 --run-code",
    "0 band campaign --gains mine:paper --learn 10 --epsilon 0.5 --confidence 0.5 --run-code",
    "0 worst campaign --gains mine:paper --budget 32 --run-code",
]


# The first cases of a verb are in CI, and the shorter of two of one kind.
LATER = [FLIES["band"][0], "0 verify band.npz --run 11 --run-code"]
LATER += [case for table in (READS, FLIES) for rows in table.values() for case in rows[1:]]
LATER += [x for verb in ("tube", "tune", "worst", "gradient") for x in READS[verb][:1]]
CHECKED = ["verify run", "verify campaign --run 1", "verify band.npz --count 1", "compare run"]
CHECKED += ["report campaign", "report band.npz", "tune scenario.toml --page tuned.html"]


def later(case):
    return [pytest.mark.counts] * (case in LATER and case[2:] not in CHECKED)


def cases(table):
    return [
        pytest.param(verb, case, id=case[2:], marks=later(case))
        for verb in table
        for case in table[verb]
    ]


@pytest.fixture(scope="module")
def received(tmp_path_factory):
    """A stranger's folder, with every kind of file that can name his code."""
    folder = written(tmp_path_factory.mktemp("received"))
    few = {"epsilon": 0.5, "confidence": 0.9, "flights": 4}
    mine = {"gains": "mine:paper", "start_deg": 2.0}
    with chdir(folder), code.running(code.Runs.NAMED):
        ft.record(flown := ft.fly("with_aircraft.toml"), "run", name="run")
        run_file(Path("mine.parquet"), flown["kinematic / mine:paper"])
        ft.run_campaign("campaign.toml", "campaign", workers=1)
        ft.tube("scenario.toml", "paper", start=0.01).save("tube.npz")
        ft.certify("scenario.toml", "paper").certificate.save("certificate.json")
        with flown_here():
            ft.band("scenario.toml", learn=10, **few, **mine).save("band.npz")
            ft.band("scenario_of_route.toml", learn=10, **few, **mine).save("route.npz")
            ft.monitor("with_aircraft.toml", learn=20, **few, **mine).save("monitor.npz")
    return folder


@pytest.fixture
def here(received, tmp_path, monkeypatch):
    """A copy of the folder, in a process that has named and run none of its code yet."""
    folder = shutil.copytree(received, tmp_path / "received")
    (folder / "ran").unlink()
    monkeypatch.setattr("flighttune.claims.mission.LEARN", 10)
    fresh(monkeypatch)
    return folder


def fresh(monkeypatch):
    monkeypatch.setattr(code, "_NAMED", set())


def told(case, folder):
    status, *command = case.split()
    return flighttune(*command, status=int(status), cwd=folder)[1]


def flying(case):
    """Where a case flies: a campaign, a mission and a count that goes on have workers, as users."""
    verb = case.split()[1]
    alone = verb in ("monitor", "worst") or (verb == "band" and "band.npz" not in case)
    return flown_here() if alone else nullcontext()


def test_every_command_is_in_the_table_of_what_it_reads():
    assert READS.keys() == COMMANDS.keys()
    assert FLIES.keys() < READS.keys()


@pytest.mark.soak
@pytest.mark.parametrize(("verb", "case"), cases(READS))
def test_a_command_runs_no_code_of_what_it_reads(here, verb, case):
    assert case.split()[1] == verb

    said = told(case, here)

    assert not (here / "ran").exists()
    assert "runs the Python code" not in said


@pytest.mark.soak
@pytest.mark.parametrize(("verb", "case"), cases(FLIES))
def test_a_command_says_once_that_it_runs_the_code_of_what_it_flies(here, verb, case):
    assert case.split()[1] == verb

    with flying(case):
        said = told(case, here)

    assert (here / "ran").exists()
    assert said.startswith(NOTICE)
    assert said.splitlines().count(NOTICE) == 1


@pytest.mark.soak
@pytest.mark.parametrize("case", [pytest.param(x, marks=later(x)) for x in WITH_RUN_CODE])
def test_code_of_a_file_of_flighttune_runs_where_that_is_allowed(here, case):
    with flying(case):
        said = told(case, here)

    assert (here / "ran").exists()
    assert said.splitlines().count(NOTICE) == 1


@pytest.mark.soak
@pytest.mark.parametrize("case", [pytest.param(x, marks=later(x)) for x in WITH_RUN_CODE])
def test_code_of_a_file_of_flighttune_runs_only_as_it_was_sent(here, case):
    """A relative path leads to a file of the reader's own where the stranger's is not."""
    (here / "law.py").write_text(f"{textwrap.dedent(LAW)}# of the reader\n")
    status = "1" if "band.npz --count" in case else "2"

    said = told(f"{status}{case[1:]}", here)

    assert not (here / "ran").exists()
    assert "`module` must be the file that was planned or recorded with" in said


# Verbs of Python on what the stranger sent.
VERBS = {
    "load run": lambda: ft.load("run"),
    "load campaign": lambda: ft.load("campaign"),
    "load band": lambda: ft.load("band.npz"),
    "verify band": lambda: ft.verify("band.npz"),
    "verify tube": lambda: ft.verify("tube.npz"),
    "refly run": lambda: ft.refly("run"),
    "refly runs": lambda: ft.refly(ft.load("run").runs),
    "refly campaign": lambda: ft.refly("campaign", 1),
    "report run": lambda: ft.report("run", "page.html"),
    "report campaign": lambda: ft.report("campaign"),
    "compare run": lambda: ft.compare("run"),
    "band campaign": lambda: ft.band("campaign", gains="mine:paper"),
    "band plan": lambda: ft.band(ft.load("campaign").plan, gains="mine:paper"),
    "worst band": lambda: ft.worst("band.npz", budget=32),
    "fly recorded": lambda: ft.fly(ft.scenario_from(ft.load("run").runs[0].provenance.scenario)),
    "environment": lambda: ft.gym.FlightEnv("campaign").reset(seed=1),
}


@pytest.mark.soak
@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_runs_no_code_of_what_it_reads(here, verb):
    with chdir(here), suppress(ft.InputError):
        VERBS[verb]()

    assert not (here / "ran").exists()


@pytest.mark.soak
def test_a_verb_that_flies_again_runs_no_code_that_the_process_has_named(here):
    ft.load_scenario(here / "scenario.toml")
    with chdir(here):
        with pytest.raises(ft.InputError, match="must be allowed by `--run-code`"):
            ft.refly("mine.parquet")
        assert not ft.verify("band.npz").valid
        assert not (here / "ran").exists()
        assert ft.refly("mine.parquet", run_code=True).equal
    assert (here / "ran").exists()


@pytest.mark.soak
def test_a_worker_runs_no_code_that_its_command_may_not(here):
    """Asked by a command that forgot to ask, and by one that may."""
    plan = ft.load(here / "campaign").plan
    with chdir(here):
        flyer, draw = Flyer(), Draw((1,), plan.values_of(0))
    try:
        with chdir(here), pytest.raises(ft.loop.PlantError, match="allowed by `--run-code`"):
            flyer.fly(work_of(plan, {}), draw)
        assert not (here / "ran").exists()
    finally:
        flyer.end()


@pytest.mark.slow
def test_no_compiled_file_runs_in_place_of_a_source(folder):
    """Python takes a file of `__pycache__` whose time and size are those of the source."""
    law, trap = folder / "law.py", textwrap.dedent(LAW)
    harmless = trap.replace('mark.write("x")', "pass").replace('"ran"', '"law.py"')
    harmless += "#" * (len(trap) - len(harmless) - 1) + "\n"
    law.write_text(trap)
    os.utime(law, (1e9, 1e9))
    py_compile.compile(str(law))
    law.write_text(harmless)
    os.utime(law, (1e9, 1e9))

    assert ft.fly(folder / "scenario.toml").runs

    assert not (folder / "ran").exists()
    spec = importlib.util.spec_from_file_location("law", law)
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
    assert (folder / "ran").exists()


@pytest.mark.slow
def test_a_plant_of_a_campaign_file_lies_beside_it(folder, tmp_path_factory):
    """And not in the working folder, where a file of its name may be another's."""
    plants = 'plant = [{ kind = "python", name = "mine", module = "law.py", class = "Mine" }]\n'
    (folder / "campaign.toml").write_text(plants + textwrap.dedent(CAMPAIGN))
    with chdir(tmp_path_factory.mktemp("elsewhere")):
        (plant,) = ft.load_campaign(folder / "campaign.toml").nominal.plant

    assert plant.module == str(folder / "law.py")
    assert plant.sha256 == hashlib.sha256((folder / "law.py").read_bytes()).hexdigest()


def test_a_dry_run_says_why_it_estimates_no_time(folder):
    plan = answer("campaign", "campaign.toml", "--dry-run", cwd=folder)

    assert (plan["runs"], plan["draws"]) == (8, 2)
    assert "core_s" not in plan
    assert plan["notes"][-1].startswith("time and space are not estimated: that runs the code of")


def test_a_plan_knows_its_code_and_draws_none(folder):
    """A file named by a draw would not be in the plan's list of code."""
    plan = ft.plan_campaign(ft.load_campaign(folder / "campaign.toml"))
    assert plan.code == (str(folder / "law.py"),)

    draws = '[{ key = "law[1].module", distribution = "choice", values = ["law.py", "e.py"] }]'
    hidden = CAMPAIGN.partition("disperse")[0] + f"disperse = {draws}"
    (folder / "campaign.toml").write_text(textwrap.dedent(hidden))
    with pytest.raises(ft.ScenarioError, match=r"must not name .*code"):
        ft.load_campaign(folder / "campaign.toml")


def test_a_file_that_has_other_contents_than_its_scenario_named_is_refused(folder):
    scenario = ft.load_scenario(folder / "scenario.toml")
    (folder / "law.py").write_text(f"{textwrap.dedent(LAW)}# changed\n")

    with pytest.raises(ft.ScenarioError, match=r"law\.py has other contents now"):
        ft.fly(scenario)

    assert not (folder / "ran").exists()
