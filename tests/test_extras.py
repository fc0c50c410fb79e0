"""A feature whose packages are not installed: one line that names the extra."""

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from commands import flighttune

import flighttune as ft
from flighttune.base import errors

OPTIONAL = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"][
    "optional-dependencies"
]
OUT_OF_NAMESAKE = {"rerun_notebook": "rerun-sdk[notebook]"}


@pytest.mark.soak
@pytest.mark.parametrize(("module", "extra"), errors.EXTRAS.items())
def test_each_module_comes_with_the_extra_of_its_message(module, extra):
    distribution = OUT_OF_NAMESAKE.get(module) or packages_distributions()[module][0]

    assert any(one.startswith(distribution) for one in OPTIONAL[extra])


def test_only_what_is_missing_is_named(monkeypatch):
    errors.need("this", "numba", "dask")
    monkeypatch.setitem(sys.modules, "dask", None)

    with pytest.raises(ft.InputError, match=r"^this needs dask; .*'flighttune\[cluster\]'$"):
        errors.need("this", "numba", "dask")


@pytest.mark.slow
def test_an_import_that_fails_inside_a_command_names_the_extra_too(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "dask", None)
    monkeypatch.setattr("flighttune.campaigns.engine.cluster.need", lambda *_: None)

    nobody = ("--scheduler", "tcp://127.0.0.1:1")
    _, said = flighttune("campaign", "first_campaign", *nobody, status=2, cwd=tmp_path)

    reason = said.splitlines()[-1]  # the progress of the campaign may stand above it
    assert reason.startswith("flighttune: this command needs dask; ")
    assert "'flighttune[cluster]'" in reason


FAILS = 'raise ImportError("\\nits core failed to import")'
SAYS = 'import sys; sys.stderr.write("compiled using NumPy 1.x, with a traceback"); '


@pytest.mark.slow
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


@pytest.mark.parametrize("module", ["made_up", "numpy", "dask.made_up"])
def test_an_import_that_no_extra_cures_stays_a_fault(module):
    assert errors.missing_extra(ModuleNotFoundError(name=module), "this") is None
