"""The public names: each one is there, documented, and not hidden by a module of the same name."""

import ast
import dataclasses
import doctest
import inspect
import io
import re
import subprocess
import sys
from operator import attrgetter
from pathlib import Path

import pytest
from fuzzing import marked
from site_reference import public_names

import flighttune

PACKAGE = Path(flighttune.__file__).parent


NAMES = public_names()
QUICK = "loop.Controller", "show", "trim"
LONG = (
    *("Band", "Certificate", "Gradient", "Meeting", "RateBound", "Residual", "Tube"),
    *("TuningResult", "identify", "mission"),
)
"""Names whose examples take long: results of verbs, whose own examples run, and two verbs."""
PUBLIC = attrgetter(*NAMES)(flighttune)


def test_every_public_name_is_there_documented_and_not_hidden_by_a_module():
    for name, value in zip(NAMES, PUBLIC, strict=True):
        assert value is not None
        assert inspect.getdoc(value) or not callable(value), name
        assert not (PACKAGE / name).exists()
        assert not (PACKAGE / f"{name}.py").exists()


@pytest.mark.parametrize(
    ("namespace", "stub"), [(flighttune, "__init__.pyi"), (flighttune.loop, "loop.pyi")]
)
def test_type_checkers_see_each_name_as_exported(namespace, stub):
    tree = ast.parse((PACKAGE / stub).read_text())
    imports = [line for line in tree.body if isinstance(line, ast.ImportFrom)]
    exported = [alias.asname for line in imports for alias in line.names]
    assert sorted(exported) == namespace.__all__


@pytest.mark.parametrize(
    ("name", "now"),
    [
        ("simulator", "$"),
        ("MimoPI", ": it is now flighttune.loop.MimoPI$"),
        ("PlantError", ": it is now flighttune.loop.PlantError$"),
        ("StoppedError", ": it is now flighttune.base.errors.StoppedError$"),
        ("FlightEnv", ": it is now flighttune.gym.FlightEnv$"),
        ("TrimError", ": it is now flighttune.base.errors.TrimError$"),
    ],
)
def test_a_name_that_is_not_there_says_where_it_went(name, now):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}'{now}"):
        getattr(flighttune, name)
    place = now.removeprefix(": it is now flighttune.").removesuffix("$")
    assert not place or attrgetter(place)(flighttune)


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        (
            "flighttune.cli",
            ["numpy", "pandas", "scipy", "jsbsim", "clarabel", "cvxpy", "rerun", "pydantic"],
        ),
        # Each worker starts with it.
        pytest.param(
            "flighttune.campaigns.engine.server",
            ["scipy.optimize", "scipy.spatial", "scipy.special", "numba", "rerun"],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_an_import_loads_nothing_heavy(module, heavy):
    code = f"import sys, {module}; print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"


REFERENCE = {
    name: page
    for page in sorted((PACKAGE.parent / "docs" / "api").glob("*.md"))
    for name in re.findall(r"^\.\. \w+:: flighttune\.([\w.]+)$", page.read_text(), re.MULTILINE)
}


def test_the_reference_has_every_public_name():
    assert sorted(REFERENCE) == sorted(NAMES)


def test_public_functions_explain_every_argument():
    for function in filter(inspect.isfunction, PUBLIC):
        text, names = inspect.getdoc(function), inspect.signature(function).parameters
        for name in names:
            explained = re.search(rf"^.*\b{name}\b.* :", text, re.MULTILINE) or f"`{name}`" in text
            assert explained or len(names) == 1, f"`{function.__name__}`: `{name}`"


def test_public_values_explain_every_attribute():
    for value in filter(dataclasses.is_dataclass, PUBLIC):
        for field in dataclasses.fields(value):
            found = re.search(rf"\b{field.name}\b.* :", inspect.getdoc(value))
            assert found, f"`{value.__name__}`: `{field.name}`"


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        *marked([x for x in NAMES if x not in LONG], pytest.mark.soak, but=QUICK),
        *marked(LONG, pytest.mark.counts, but=()),
    ],
)
def test_the_example_of_a_public_name_runs_as_it_is_printed(name, tmp_path, monkeypatch):
    if name == "show":
        pytest.importorskip("rerun_notebook", reason="needs flighttune[notebook]")
        # Outside of a notebook the widget would be printed; tests/test_notebook.py shows it.
        monkeypatch.setattr("rerun.notebook.Viewer.display", lambda self: None)
    monkeypatch.chdir(tmp_path)
    value, page = attrgetter(name)(flighttune), REFERENCE[name].read_text()
    text = inspect.getdoc(value) if callable(value) else page.partition(f".{name}\n")[2]
    # Python names the module of an error, pages do not.
    text = re.sub(r"^( *)(\w+Error): ", r"\1flighttune.base.errors.\2: ", text, flags=re.MULTILINE)
    example = doctest.DocTestParser().get_doctest(text, {"ft": flighttune}, name, None, 0)
    said = io.StringIO()

    assert example.examples
    assert not doctest.DocTestRunner().run(example, out=said.write).failed, said.getvalue()
