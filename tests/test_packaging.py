"""The container file and the recipe of conda-forge agree with pyproject.toml."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.specifiers import SpecifierSet
from rattler_build import Stage0Recipe, VariantConfig

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RECIPE_TEXT = (ROOT / "release/recipe.yaml").read_text(encoding="utf-8")
RECIPE = yaml.safe_load(RECIPE_TEXT)
CONTAINER = (ROOT / "release/Containerfile").read_text(encoding="utf-8")


def test_the_recipe_needs_what_the_package_needs():
    needs = {re.sub(r"\s", "", line) for line in RECIPE["requirements"]["run"]}

    assert needs - {"python>=${{python_min}}"} == {*PROJECT["project"]["dependencies"]}
    assert {*PROJECT["build-system"]["requires"]} <= {
        re.sub(r"\s", "", line) for line in RECIPE["requirements"]["host"]
    }


def test_the_builder_of_conda_forge_renders_the_recipe_as_one_package_for_all_systems():
    (variant,) = Stage0Recipe.from_yaml(RECIPE_TEXT).render(VariantConfig())
    rendered = variant.recipe.to_dict()

    assert rendered["package"] == {name: PROJECT["project"][name] for name in ("name", "version")}
    assert rendered["build"]["noarch"] == "python"
    oldest = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert f"python >={oldest}" in rendered["requirements"]["run"]
    assert f"python {oldest}.*" in rendered["requirements"]["host"]
    assert "${{" not in str(rendered["source"])


def test_the_recipe_has_the_licences_and_commands_of_the_package():
    about, project = RECIPE["about"], PROJECT["project"]
    commands = [f"{name} = {place}" for name, place in project["scripts"].items()]

    assert (about["license"], about["license_file"]) == (
        project["license"],
        project["license-files"],
    )
    assert RECIPE["build"]["python"]["entry_points"] == commands
    assert f">={RECIPE['context']['python_min']}" == project["requires-python"]


def test_the_container_has_a_python_of_the_package_and_every_file_of_its_wheel():
    (version,) = re.findall(r"^FROM python:([\d.]+)-slim$", CONTAINER, re.MULTILINE)
    copied = {
        word
        for line in re.findall(r"^COPY (.*) \S+$", CONTAINER, re.MULTILINE)
        for word in shlex.split(line)
    }
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["include"]

    assert version in SpecifierSet(PROJECT["project"]["requires-python"])
    assert {*wheel, "pyproject.toml", "hatch_build.py", "README.md", "LICENSE"} == copied
    assert all((ROOT / name).exists() for name in copied)


@pytest.mark.parametrize("name", ["Containerfile", "recipe.yaml"])
def test_packages_come_from_public_places_alone(name):
    text = (ROOT / "release" / name).read_text(encoding="utf-8")

    hosts = {*re.findall(r"https?://([^/\s\"]+)", text)}
    assert hosts <= {"pypi.org", "arxiv.org"}
