"""Imports point one way, between packages and inside them; heavy libraries stay behind one door."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest

from flighttune.base import answering
from flighttune.claims.verify import AnyClaim
from flighttune.outputs.pages import claim

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "flighttune"
ONLY_IN = {
    "cvxpy": "control/theory/lmi.py",
    "dask": "campaigns/engine/cluster",
    "distributed": "campaigns/engine/cluster",
    "gymnasium": "gym/",
    "jsbsim": "vehicles/plants/jsbsim",
    "capstone": "compiled/",
    "llvmlite": "compiled/machine.py",
    "numba": "flight/loop/kernel.py",
    "pymavlink": "logs/read.py",
    "pyulog": "logs/read.py",
    "rasterio": "routes/raster.py",
    # A recording names the runs it was drawn from.
    "rerun": ("outputs/recording", "flight/records/parquet.py"),
    "stable_baselines3": "gym/baselines.py",
    "starlette": "outputs/live/server.py",
    "uvicorn": "outputs/live/",
}  # a file, or the folder it may be used in


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def statements(nodes):
    """The statements of a block, at any depth; expressions, most of a tree, are passed over."""
    for node in nodes:
        yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, block, ()))


@cache
def nodes_of(path):
    """Statements and definitions of a file, at any depth."""
    return [*statements(tree_of(path).body)]


def imported_modules(path):
    """Every module that a file names, in functions and under TYPE_CHECKING too."""
    for node in nodes_of(path):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} has a relative import"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def where(path):
    return path.relative_to(PACKAGE).as_posix()


MODULES = {
    "flighttune." + where(path).removesuffix(".py").replace("/", "."): path
    for path in sorted(PACKAGE.rglob("[!_]*.py"))
    if "_shipped" not in path.parts
}


@pytest.fixture(scope="module")
def imported():
    """What each module imports, by its name."""
    return {name: set(imported_modules(path)) for name, path in MODULES.items()}


@pytest.fixture(scope="module")
def imports(imported):
    """What each module imports of the package."""
    return {name: (modules & MODULES.keys()) - {name} for name, modules in imported.items()}


def folder_of(module, depth):
    return ".".join(module.split(".")[: depth + 1])


def circle_of(graph):
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as found:
        return " <- ".join(found.args[1])
    return None


def test_no_module_is_reached_from_its_own_imports(imports):
    assert circle_of(imports) is None


@pytest.mark.parametrize("depth", [1, 2], ids=["packages", "folders of packages"])
def test_folders_import_each_other_one_way(imports, depth):
    graph = defaultdict(set)
    for module, others in imports.items():
        own = folder_of(module, depth)
        graph[own] |= {folder_of(other, depth) for other in others} - {own}
    assert circle_of(graph) is None


def rows_of_the_map():
    """Packages in docs/architecture.md, lowest first; those of one row do not import each other."""
    block = (
        (ROOT / "docs/architecture.md").read_text(encoding="utf-8").split("```\nflighttune/\n")[1]
    )
    for line in block.split("\n```")[0].splitlines():
        if re.match(r"  \w", line):
            yield re.split(r"\s{2,}", line.strip())[0].replace("/", "").split()


def test_the_map_in_the_docs_names_every_room_and_imports_point_up_the_list(imports):
    rank = {package: row for row, packages in enumerate(rows_of_the_map()) for package in packages}
    names = {folder_of(module, 1).removeprefix("flighttune.") for module in MODULES}
    assert set(rank) == names
    for module, others in imports.items():
        own = rank[folder_of(module, 1).removeprefix("flighttune.")]
        for other in others:
            package = folder_of(other, 1).removeprefix("flighttune.")
            if not module.startswith(f"flighttune.{package}"):
                assert rank[package] < own or own == rank[package] == 0, f"{module} imports {other}"


def test_each_place_that_the_page_names_is_there():
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    named = re.findall(r"`(\w+/[\w/]+\.(?:py|toml))(?::(\w+))?`", page)
    assert len(named) > 20
    for place, name in named:
        path = next((base / place for base in (PACKAGE, ROOT) if (base / place).is_file()), None)
        assert path or "NAME" in place, place
        assert not name or re.search(rf"^(class|def) {name}\b", path.read_text(), re.M), name


def lines_of_results():
    """Each class of results that no other is made of, with the classes that it is made of."""
    bases = {}
    for path in MODULES.values():
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                bases[node.name] = {ast.unparse(base).split(".")[-1] for base in node.bases}

    def line(name):
        return {name}.union(*(line(base) for base in bases.get(name, ())))

    lines = {name: line(name) for name in bases.keys() - set().union(*bases.values())}
    return {name: classes for name, classes in lines.items() if "Answering" in classes}


def test_every_result_that_answers_has_its_row_in_the_table_of_functions_that_speak():
    lines = lines_of_results()
    assert len(lines) > 20
    for name, classes in lines.items():
        assert classes & answering.SPEAKERS.keys(), name
        assert "Drawn" not in classes or classes & answering.FIGURES.keys(), name
    assert answering.SPEAKERS.keys() <= {"Run"}.union(*lines.values())
    assert answering.FIGURES.keys() <= answering.SPEAKERS.keys()
    for place in (*answering.SPEAKERS.values(), *answering.FIGURES.values()):
        module, _, function = place.partition(":")
        assert module.startswith("flighttune.outputs.")
        assert callable(getattr(import_module(module), function)), place


def test_only_outputs_and_commands_speak(imports):
    """Below them no module makes a table or an answer, and no class says what it is itself."""
    for module, others in imports.items():
        room = folder_of(module, 1).removeprefix("flighttune.")
        if room in ("outputs", "cli"):
            continue
        assert not [x for x in others if x.startswith("flighttune.outputs.")], module
        for node in nodes_of(MODULES[module]):
            if isinstance(node, ast.ClassDef) and node.name != "Answering":
                methods = {x.name for x in node.body if isinstance(x, ast.FunctionDef)}
                assert "answer" not in methods, f"{module}: {node.name}"


def test_every_claim_has_its_row_in_the_tables_of_pages():
    for kind in get_args(AnyClaim):
        assert {base.__name__ for base in kind.__mro__} & claim.PAGES.keys(), kind
    for place in (*claim.PAGES.values(), *claim.CHARTS.values()):
        module, _, function = place.partition(":")
        assert callable(getattr(import_module(module), function)), place


def test_a_result_without_a_row_says_where_it_must_have_one():
    class Mute(answering.Answering):
        pass

    with pytest.raises(NotImplementedError, match=r"`Mute` must have a row in the tables of"):
        Mute().answer()


# Rooms that may become distributions of their own: libraries and rooms that all their modules load.
STAND_ALONE = {"compiled": {"numpy", "base"}}

LOADED = """
import sys
before = set(sys.modules)
for module in sys.argv[1:]:
    __import__(module)
print(*{name for name in sys.modules if name not in before})
"""


@pytest.mark.parametrize("room", STAND_ALONE)
def test_a_room_that_stands_alone_loads_little(room):
    own = [name for name in MODULES if folder_of(name, 1) == f"flighttune.{room}"]
    command = [sys.executable, "-c", LOADED, *own]
    names = subprocess.check_output(command, cwd=ROOT, text=True).split()
    loaded = {name.split(".")[0] for name in names} - sys.stdlib_module_names - {"flighttune"}
    loaded |= {folder_of(name, 1).removeprefix("flighttune.") for name in names if name in MODULES}

    assert {*own} <= {*names}
    assert loaded - {room} == STAND_ALONE[room]


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_heavy_library_is_imported_in_one_place(imported, library):
    for name, path in MODULES.items():
        roots = {module.split(".")[0] for module in imported[name]}
        assert library not in roots or where(path).startswith(ONLY_IN[library]), where(path)


def test_text_files_have_the_same_encoding_and_line_ends_on_every_system():
    """UTF-8 is said where they are read; one function writes them, with the line ends of Unix."""
    for path in MODULES.values():
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                called = f"{where(path)}:{node.lineno}: {node.func.attr}"
                assert node.func.attr != "write_text", called
                assert node.func.attr != "read_text" or node.keywords, called


def test_marks_of_soak_are_in_the_files_that_they_mark():
    """`make soak` imports only the files that have one."""
    marking = [path for path in (ROOT / "tests").rglob("*.py") if "mark.soak" in path.read_text()]

    assert len(marking) > 10
    assert {path.name for path in marking if not path.name.startswith("test_")} == {"conftest.py"}
