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
        by_gains: ClassVar[bool] = True
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
NEW = "--gains rectangles:paper"
BOTH = 'paper_as_printed --set law=["paper","rectangles"] --set expect=[] --set flight.duration_s=3'
COMMANDS = {
    f"fly {BOTH} --out runs/both": 0,
    "verify runs/both": 0,
    "report runs/both -o page.html": 0,
    "compare paper_as_printed@paper paper_as_printed@rectangles:paper": 0,
    f"tune {BOTH}": 0,
    f"certify {BOTH} --gains rectangles:tuned --envelope": 0,
    f"campaign kinematic_sweep {NEW} --runs 2 --out runs/many --workers 1": 0,
    "report runs/many": 0,
    f"tube paper_as_printed {NEW}": 2,
    f"export paper {NEW} --format c --out c": 2,
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
    places = {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": f"{copy}{os.pathsep}{ROOT / 'tests'}"}
    run = [sys.executable, "-c", IN_ONE_PROCESS]
    options = {"cwd": folder, "env": {**os.environ, **places}, "input": json.dumps(COMMANDS)}
    done = subprocess.run(run, **options, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    printed = zip(COMMANDS.items(), json.loads(done.stdout), strict=True)
    return {
        re.match(r"report runs/many|(campaign )?\w+", line)[0]: err if status else json.loads(out)
        for (line, status), (out, err) in printed
    }


pytestmark = pytest.mark.slow


@pytest.mark.soak
def test_it_is_flown_recorded_flown_again_compared_and_reported(told):
    statuses = {run["gains"]: run["status"] for run in told["fly"]["runs"]}
    assert statuses["rectangles:paper"] == "completed"
    assert told["verify"]["equal"]
    assert "kinematic / rectangles:paper" in json.dumps(told["report"])
    for command in ("compare", "report runs/many"):
        assert "rectangles:paper" in json.dumps(told[command])


@pytest.mark.soak
def test_its_gains_are_tuned_and_certified_on_its_linear_model(told):
    tuned, certified = told["tune"], told["certify"]

    assert certified["K_P"] == tuned["K_P"]
    assert certified["R_K"] == pytest.approx(tuned["R_K"])
    assert certified["certificate"]["status"] == "certified"


@pytest.mark.soak
@pytest.mark.parametrize("command", ["tube", "export"])
def test_what_it_does_not_say_is_refused_by_its_name(told, command):
    assert "`gains` must be flown by the law paper" in told[command]
    assert "the law 'rectangles'" in told[command]
