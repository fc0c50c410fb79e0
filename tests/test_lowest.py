"""The lowest versions that pyproject.toml allows, with every extra: what README says works."""

import os
import re
import subprocess
import sys
import tomllib

import pytest
from bounds import uv
from places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"].keys() - {"dev", "docs"}  # which fly nothing

# Each command and whether its answer is no, as its comment says.
COMMANDS = [
    (re.sub(r"--budget \d+", "--budget 48", command.split(" #")[0]), "exit status 1" in command)
    for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    for command in block.splitlines()
    if re.match(r"flighttune (?!view|open)", command)
]
PYTHON = "\n".join(re.findall(r"```python\n(.*?)```", README, re.DOTALL))

# In one process: to import all that a command needs for each would take half of the time.
FLOWN = f"""
import importlib, shlex, sys
from flighttune.base.errors import EXTRAS
for module in EXTRAS:
    importlib.import_module(module)
from flighttune.cli import main
for command, no in {COMMANDS}:
    sys.argv = shlex.split(command)
    try:
        main()
        status = 0
    except SystemExit as ended:
        status = ended.code or 0
    assert status == no, (command, status)
{PYTHON}
"""


def lowest_of(requirement):
    """Name and lowest version of a requirement."""
    return re.match(r"([\w-]+)(?:\[\w+\])?>=([\d.]+)", requirement).groups()


@pytest.mark.soak
def test_the_lowest_versions_of_all_dependencies_fly_readme(tmp_path):
    environment, python = tmp_path / "lowest", tmp_path / "lowest" / "bin" / "python"
    uv("venv", "--python", sys.executable, environment)
    package = f"{ROOT}[{','.join(sorted(EXTRAS))}]"
    uv("pip", "install", "--python", python, "--resolution", "lowest-direct", package)
    listed = (
        "from importlib.metadata import distributions as d; print({x.name: x.version for x in d()})"
    )

    def run(code):
        return subprocess.run(
            [python, "-W", "ignore", "-c", code], cwd=tmp_path, check=False,
            capture_output=True, text=True, env=os.environ | {"PYTHONPATH": ""},
        )  # fmt: skip

    installed = {x.lower().replace("_", "-"): y for x, y in eval(run(listed).stdout).items()}
    stated = [*PROJECT["dependencies"]]
    stated += [x for extra in EXTRAS for x in PROJECT["optional-dependencies"][extra]]
    for name, lowest in map(lowest_of, stated):
        assert (installed[name] + ".0.0").startswith(f"{lowest}."), name
    assert len(COMMANDS) >= 7

    done = run(FLOWN)

    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "flight.svg").is_file()
    assert "Traceback" not in done.stderr
