"""Imports point downwards, and heavy libraries stay behind one module each."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "flighttune"
LAYERS = (
    "errors units palette",
    "arrays shipped whole_file",
    "figures notebook",
    "theory control",
    "plants",
    "simulate",
    "metrics",
    "tuning",
    "certificates",
    "scenario",
    "outer_loop",
    "one_flight expectations",
    "flight",
    "gap refly",
    "recording",
    "comparison",
    "report",
    "paper campaign",
    "cli",
)  # lowest first; names in one row do not import each other
CAMPAIGN = ("intervals", "planning", "flying dataset", "engine report", "choice")


def ranked(rows):
    return {name: rank for rank, row in enumerate(rows) for name in row.split()}


RANK, RANK_OF_CAMPAIGN = ranked(LAYERS), ranked(CAMPAIGN)
ONLY_IN = {
    "cvxpy": "theory/lmi.py",
    "dask": "campaign/engine/cluster",
    "distributed": "campaign/engine/cluster",
    "fsspec": "campaign/dataset/storage.py",
    "jsbsim": "plants/jsbsim",
    "numba": "simulate/batch",
    "rerun": "recording",
}  # a file, or the folder it may be used in
MODULES = sorted(path for path in PACKAGE.rglob("[!_]*.py") if "shipped" not in path.parent.parts)


def imported_modules(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} has a relative import"
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_point_downwards(path):
    where = path.relative_to(PACKAGE).as_posix()
    layer = where.split("/")[0].removesuffix(".py")
    for module in imported_modules(path):
        root, *rest = module.split(".")
        assert where.startswith(ONLY_IN.get(root, where)), f"{where} may not import {root}"
        if root == "flighttune" and rest and rest[0] != layer:
            assert RANK[rest[0]] < RANK[layer], f"{where} imports upwards: {module}"


@pytest.mark.parametrize(
    "path",
    [path for path in MODULES if path.is_relative_to(PACKAGE / "campaign")],
    ids=lambda path: path.relative_to(PACKAGE / "campaign").as_posix(),
)
def test_rooms_of_a_campaign_import_downwards_too(path):
    room = path.relative_to(PACKAGE / "campaign").parts[0].removesuffix(".py")
    for module in imported_modules(path):
        if module.startswith("flighttune.campaign.") and module.split(".")[2] != room:
            other = module.split(".")[2]
            assert RANK_OF_CAMPAIGN[other] < RANK_OF_CAMPAIGN[room], f"{path}: {module}"
