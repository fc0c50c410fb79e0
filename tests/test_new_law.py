"""A law that is one new file of `flighttune.control.laws`, in every command."""

import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

LAW = '''
    """The paper's law without its anti-windup, integrated by rectangles."""

    from math import cos
    from typing import ClassVar
    from flighttune.control.law import Law

    class Rectangles(Law):
        kind: ClassVar[str] = "rectangles"
        def make(self, setup):
            return Controller(setup.dt, setup.gains)

    class Controller:
        signals = {"phi_sum": "rad"}
        def __init__(self, dt, gains):
            self.dt, self.gains = dt, gains
        def start(self, condition):
            self.sum = 0.0 * self.gains.K_P[0]
        def step(self, measured, reference, t):
            error = reference.chi - measured.chi, reference.gamma - measured.gamma
            phi, n_z = self.gains.K_P @ error + self.sum
            self.sum = self.sum + self.dt * (self.gains.K_I @ error)
            return phi, n_z + cos(measured.gamma) / cos(measured.phi), self.sum[0]
'''
SCENARIO = """
    title = "two laws"
    law   = ["paper", "rectangles"]
    gains = ["paper"]

    [flight]
    V_a_mps    = 25.0
    duration_s = 4.0

    [reference]
    chi_deg   = 10.0
    gamma_deg = 0.0

    [limits]
    phi_deg = [-45.0, 45.0]

    [controller]
    feed_forward = true

    [envelope]
    V_a_mps   = [24.0, 26.0]
    gamma_deg = [-1.0, 1.0]
    phi_deg   = [-5.0, 5.0]
    n_z       = [0.9, 1.1]

    [[plant]]
    kind = "kinematic"
"""
CAMPAIGN = """
    title    = "both laws dispersed"
    scenario = "both.toml"
    runs     = 12

    [[disperse]]
    key          = "flight.chi_deg"
    distribution = "uniform"
    lower        = -5.0
    upper        = 5.0
"""


COMMANDS = {
    "fly both.toml --out runs/both": 0,
    "refly runs/both": 0,
    "report runs/both -o page.html": 0,
    "compare both.toml@paper both.toml@rectangles:paper": 0,
    "tune both.toml": 0,
    "certify both.toml --gains rectangles:tuned --envelope": 0,
    "campaign run many.toml --out runs/many --workers 1": 0,
    "report runs/many": 0,
    "tube both.toml --gains rectangles:paper": 2,
    "export both.toml --gains rectangles:paper --format c --out c": 2,
}
"""Each with its exit status."""

IN_ONE_PROCESS = """
import json, sys
from commands import flighttune
told = [flighttune(*line.split(), "--json", status=n) for line, n in json.load(sys.stdin).items()]
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What each command prints with the law in a copy of the package.

    Its kernel is interpreted: to compile it takes longer than the few flights.
    """
    folder = tmp_path_factory.mktemp("new_law")
    copy = folder / "src"
    shutil.copytree(ROOT / "flighttune", copy / "flighttune")
    for name in ("scenarios", "aircraft"):
        (copy / name).symlink_to(ROOT / name)
    file = copy / "flighttune/control/laws/rectangles.py"
    file.write_text(textwrap.dedent(LAW))
    (folder / "both.toml").write_text(textwrap.dedent(SCENARIO))
    (folder / "many.toml").write_text(textwrap.dedent(CAMPAIGN))
    done = subprocess.run(
        [sys.executable, "-c", IN_ONE_PROCESS],
        cwd=folder,
        env={
            **os.environ,
            "NUMBA_DISABLE_JIT": "1",
            "PYTHONPATH": f"{copy}{os.pathsep}{ROOT / 'tests'}",
        },
        input=json.dumps(COMMANDS),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    printed = zip(COMMANDS.items(), json.loads(done.stdout), strict=True)
    return {
        re.match(r"report runs/many|(campaign )?\w+", line)[0]: err if status else json.loads(out)
        for (line, status), (out, err) in printed
    }


pytestmark = pytest.mark.slow


def test_it_is_flown_recorded_flown_again_and_reported(told):
    (run,) = (one for one in told["fly"]["runs"] if one["gains"] == "rectangles:paper")
    assert run["status"] == "completed"
    assert told["refly"]["equal"]
    assert "kinematic / rectangles:paper" in json.dumps(told["report"])


def test_it_is_compared_with_the_papers_law_it_is_like(told):
    assert "rectangles:paper" in json.dumps(told["compare"])


def test_its_gains_are_tuned_and_certified_on_its_linear_model(told):
    tuned, certified = told["tune"], told["certify"]

    assert certified["K_P"] == tuned["K_P"]
    assert certified["R_K"] == pytest.approx(tuned["R_K"])
    assert certified["certificate"]["status"] == "certified"


def test_it_is_flown_in_a_campaign(told):
    assert "rectangles:paper" in json.dumps(told["report runs/many"])


@pytest.mark.parametrize("command", ["tube", "export"])
def test_what_it_does_not_say_is_refused_by_its_name(told, command):
    assert "`gains` must be flown by the law paper" in told[command]
    assert "the law 'rectangles'" in told[command]
