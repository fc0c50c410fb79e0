"""A feature whose packages are not installed: one line that names the extra."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

OPTIONAL = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"][
    "optional-dependencies"
]


WITHOUT = """
import sys
sys.modules[sys.argv[1]] = None
from flighttune.cli import main
sys.argv[1:2] = []
main()
"""
NEEDS = {"dask": ("cluster", "campaign first_campaign --scheduler tcp://127.0.0.1:1")}


@pytest.mark.slow
@pytest.mark.parametrize("module", NEEDS)
def test_a_command_without_its_packages_names_the_extra_that_has_them(module, tmp_path):
    extra, command = NEEDS[module]

    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, module, *command.split()],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip

    reason = done.stderr.splitlines()[-1]
    assert done.returncode == 2
    assert re.match(f"flighttune: .*{module}; .*'flighttune\\[{extra}\\]'$", reason)
    assert any(one.startswith(module) for one in OPTIONAL[extra])


FAILS = 'raise ImportError("\\nits core failed to import")'
SAYS = 'import sys; sys.stderr.write("compiled using NumPy 1.x, with a traceback"); '


@pytest.mark.soak
@pytest.mark.parametrize("library", ["shapely", "scipy", "jsbsim", "pyarrow", "rerun"])
def test_a_library_that_cannot_be_imported_is_named_in_one_line(library, tmp_path):
    """Not as a lack of memory, and without what NumPy prints of it."""
    (tmp_path / library).mkdir()
    (tmp_path / library / "__init__.py").write_text(SAYS * (library == "shapely") + FAILS)

    done = subprocess.run(
        [sys.executable, "-m", "flighttune", "fly", "paper"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)}, cwd=tmp_path,
        capture_output=True, text=True, check=False,
    )  # fmt: skip

    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert re.match(rf"flighttune: {library}( [\d.]+)?: .* its core failed to import\.$", line)
