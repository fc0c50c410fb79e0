"""What ships with the package is found by name, wherever it is installed."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from flighttune import shipped
from flighttune.errors import InputError

REPOSITORY = Path(__file__).parents[1]


def test_every_aircraft_folder_of_the_checkout_is_listed():
    names = {path.name for path in (REPOSITORY / "aircraft").iterdir() if path.is_dir()}

    assert set(shipped.aircraft_names()) == names


def test_every_scenario_of_the_checkout_is_listed():
    names = {path.stem for path in (REPOSITORY / "scenarios").glob("*.toml")}

    assert set(shipped.scenario_files()) == names


def test_every_campaign_of_the_checkout_is_listed():
    names = {path.stem for path in (REPOSITORY / "scenarios/campaigns").glob("*.toml")}

    assert set(shipped.campaign_files()) == names
    assert not names & set(shipped.scenario_files())


@pytest.mark.parametrize("name", ["lost", "", "..", "../aircraft/aerosonde", "/etc"])
def test_an_unknown_aircraft_is_answered_with_those_there_are(name):
    with pytest.raises(InputError, match=rf"`aircraft` must be one of \w+.*, got '{name}'"):
        shipped.aircraft_folder(name)


FLY = """
from pathlib import Path
import flighttune
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.shipped import campaign_files, scenario_files
print(Path(flighttune.__file__).parent)
plant = JSBSimPlant("aerosonde")
plant.start(FlightCondition(V_a=25.0))
print(plant.advance(0.2, 1.0, 1.0))
print(scenario_files()["paper"].is_file(), campaign_files()["first_campaign"].is_file())
"""


@pytest.mark.slow
def test_the_wheel_holds_the_aircraft_and_flies_it(tmp_path):
    """Built from a copy of the sources, unpacked away from the checkout."""
    hatchling = pytest.importorskip("hatchling.build", reason="needs the build backend")
    del hatchling
    source, site = tmp_path / "source", tmp_path / "site"
    for name in ("flighttune", "aircraft", "scenarios"):
        shutil.copytree(REPOSITORY / name, source / name)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(REPOSITORY / name, source / name)
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path],
        cwd=source, check=True, capture_output=True,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)

    flown = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(site)!r})\n{FLY}"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip

    assert flown.stdout.splitlines() == [str(site / "flighttune"), "None", "True True"]
    assert flown.stderr == ""
