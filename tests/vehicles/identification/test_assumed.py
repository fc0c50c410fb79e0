"""What a model assumes is said wherever something rests on it: terminal, JSON, pages and files."""

import json
import shutil

import pytest
from commands import answer, flighttune

import flighttune as ft

SAID = "Assumed, not measured: n_z of kite follows its command at 4 rad/s."

TURN = """
title = "A turn"
law = "exact"
[[gains]]
name = "own"
law = "exact"
K_P = [[1.2, 0.0], [0.0, 1.2]]
K_I = [[0.2, 0.0], [0.0, 0.3]]
[flight]
V_a_mps = 25.0
duration_s = 8.0
[reference]
chi_deg = 4.0
gamma_deg = 0.0
[limits]
phi_deg = [-45.0, 45.0]
[tuning]
model = "identified"
{tuning}
[[plant]]
{plant}
[[expect]]
at_most.chi.MO_deg = 5.0
"""

COUNTED = "--epsilon 0.5 --confidence 0.5 --learn 10 --flights 10"

CAMPAIGN = """
title = "Turns"
scenario = "{scenario}"
runs = 2
[[disperse]]
key = "flight.chi_deg"
distribution = "uniform"
lower = -0.5
upper = 0.5
acts = "adds"
"""


def channel(w):
    """What a file says of a channel behind a first-order lag."""
    lag = {"order": 1, "natural_frequency_rad_s": w, "damping": None, "lag_s": None, "delay_s": 0.0}
    return {
        **lag, "fit_percent": 0.0, "residual": 1.0, "cross": None, "simpler": lag,
        "bandwidth_rad_s": w,
    }  # fmt: skip


def identified():
    """A model as a file has it, whose load-factor lag is assumed."""
    phi, n_z, turned = 5.0, 4.0, -9.80665 / 25.0
    model = {
        "states": ["chi", "gamma", "phi", "n_z"],
        "inputs": ["phi_cmd", "n_z_cmd"],
        "errors": ["chi", "gamma"],
        "A": [[0, 0, turned, 0], [0, 0, 0, turned], [0, 0, -phi, 0], [0, 0, 0, -n_z]],
        "B": [[0, 0], [0, 0], [phi, 0], [0, n_z]],
        "C": [[1, 0, 0, 0], [0, 1, 0, 0]],
    }
    log = {
        "logs": ["kite"], "assumed": ["n_z"], "frequency_95_rad_s": {}, "delay_95_s": {},
        "stretches": {"phi": 3}, "phi_deg": [-45.0, 45.0], "phi_rate_dps": 60.0,
        "n_z": [0.5, 1.9], "n_z_rate_per_s": 1.5, "residual_rad_s": None, "residual_stretches": 0,
    }  # fmt: skip
    condition = {"V_a_mps": 25.0, "gamma_deg": 0.0, "h_m": 500.0, "model": model}
    condition["channels"] = {"phi": channel(phi), "n_z": channel(n_z)}
    made = {"format": "flighttune identified aircraft 1", "aircraft": "kite", "seed": 0}
    return json.dumps(made | {"log": log, "conditions": [condition]})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model whose load-factor lag is assumed, and scenarios that rest on it."""
    folder = tmp_path_factory.mktemp("assumed")
    (folder / "mine.json").write_text(identified())
    # Whole paths: worker processes may have begun in another folder.
    named = f'identified = "{(folder / "mine.json").as_posix()}"'
    own = f'kind = "point_mass_lag"\n{named}'
    (folder / "own.toml").write_text(TURN.format(tuning="", plant=own))
    aerosonde = 'kind = "jsbsim"\naircraft = "aerosonde"'
    (folder / "flown.toml").write_text(TURN.format(tuning=named, plant=aerosonde))
    for name in ("own", "flown"):
        (folder / f"{name}_all.toml").write_text(CAMPAIGN.format(scenario=f"{name}.toml"))
    return folder


@pytest.fixture(scope="module")
def made(folder):
    """What rests on them: runs, gains and a proof."""
    flighttune("fly", "own.toml", "--out", "runs", cwd=folder)
    flighttune("tune", "own.toml", "--out", "gains.json", cwd=folder)
    flighttune("certify", "own.toml", "--out", "proof.json", cwd=folder)


@pytest.fixture(scope="module")
def counted(folder):
    """And rows of a campaign and a band."""
    flighttune("campaign", "own_all.toml", "--out", "rows", cwd=folder)
    band = f"band own.toml --start-deg 1 --out own.npz {COUNTED}"
    flighttune(*band.split(), cwd=folder)


COMMANDS = {
    "identified": "new again --aircraft mine.json",
    "flown": "fly own.toml --out again",
    "tuned": "tune own.toml --page tune.html",
    "certified": "certify own.toml",
    "met": "meet own.toml --start own --budget 1 --page meet.html",
    "campaign": "campaign own_all.toml --out again3",
    "counted": f"band own.toml --start-deg 1 --out again.npz {COUNTED}",
    "worst": "worst own_all.toml --budget 32",
    "frontier": "tune own.toml --frontier --points 2 --set tuning.model=kinematic --out frontier",
    "exported in C": "export own.toml --format c --out c",
    "gap": "gap flown.toml --out gap",
    "exported": "export flown.toml --out folder",
    "gains flown elsewhere": "fly level_turn --gains gains.json --set flight.duration_s=4 "
    "--out elsewhere",
    "page of flights": "report runs --out report.html",
    "flights compared": "compare runs again2 --out compare.html",
    "page of a campaign": "report rows --out rows.html",
    "page of a band": "report own.npz --out band.html",
    "proof verified": "verify proof.json",
    "proof shown": "report proof.json --out proof.html",
}


# Pages and other texts for a reader, with which a command answers too.
PAGES = {
    "tuned": ["tune.html"],
    "met": ["meet.html"],
    "gap": ["gap/gap.html"],
    "flights compared": ["compare.html"],
    "page of flights": ["report.html"],
    "page of a campaign": ["rows.html"],
    "page of a band": ["band.html"],
    "exported in C": ["c/ft_outer_loop.c"],
    "exported": ["folder/README.md"],
    "identified": ["again.toml"],
}


QUICK, LONGER = ("identified",), ("exported", "gap", "page of a campaign", "page of a band")
MARKS = dict.fromkeys(QUICK, pytest.mark.slow) | dict.fromkeys(LONGER, pytest.mark.soak)


@pytest.mark.parametrize(
    "kind", [pytest.param(x, marks=MARKS.get(x, pytest.mark.counts)) for x in COMMANDS]
)
def test_what_rests_on_an_assumption_says_so(kind, folder, request):
    arguments = COMMANDS[kind].split()
    if kind not in QUICK:
        request.getfixturevalue("made")
    if "page of a" in kind:
        request.getfixturevalue("counted")
    if kind == "flights compared":
        shutil.copytree(folder / "runs", folder / "again2", dirs_exist_ok=True)

    said, errors = flighttune(*arguments, cwd=folder, status=None)

    assert SAID in " ".join(said.split()), errors
    for page in PAGES.get(kind, ()):
        assert SAID in (folder / page).read_text(encoding="utf-8")


@pytest.mark.slow
def test_files_carry_it(folder, made, tmp_path):
    assert SAID in json.loads((folder / "gains.json").read_text())["tuned_for"]["assumed"]
    assert SAID in json.loads((folder / "proof.json").read_text())["assumed"]
    moved = shutil.copytree(folder / "runs", tmp_path / "runs")
    for run in ft.load(moved).runs:  # where the model is not
        assert SAID in run.provenance.scenario["assumed"]


@pytest.mark.slow
def test_the_json_object_of_a_flight_carries_it(folder):
    said = answer("fly", "own.toml", "--out", "json", cwd=folder)

    assert SAID in said["notes"]


def test_a_model_that_assumes_nothing_says_nothing():
    assert ft.loop.load_identified("aerosonde").assumptions == ()
    assert ft.load_scenario("circuit").assumptions == ()
    assert "assumed" not in ft.load_scenario("circuit").as_dict()
