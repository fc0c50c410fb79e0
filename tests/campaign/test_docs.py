"""The recipes of docs/campaigns.md: Python and YAML that parse, options that exist."""

import ast
import re
from pathlib import Path

import pytest
from commands import flighttune

from flighttune.campaign.engine.progress import CampaignOutcome

PAGE = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
FENCES = re.findall(r"^```(\w*)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("code", [text for kind, text in FENCES if kind == "python"])
def test_python_parses_and_imports_of_ours_exist(code):
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("flighttune"):
            module = __import__(node.module, fromlist=["x"])
            assert all(hasattr(module, alias.name) for alias in node.names)


def test_what_the_json_object_holds_is_said():
    running = PAGE[PAGE.index("## Running") : PAGE.index("## On a cluster")]

    assert all(f"`{name}`" in running for name in CampaignOutcome.__slots__)


def test_options_that_are_named_exist():
    running = PAGE[PAGE.index("## Running") : PAGE.index("## The dataset")]
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", running))
    known, _ = flighttune("campaign", "run", "--help")

    of_dask = {"--host", "--port", "--nworkers", "--nthreads", "--name", "--no-dashboard"}
    assert named - of_dask <= set(re.findall(r"--[a-z][a-z-]+", known))
