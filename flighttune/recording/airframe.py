"""How wide the aircraft of a run is."""

import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from flighttune.errors import InputError
from flighttune.recording.mesh import SPAN
from flighttune.shipped import aircraft_folder
from flighttune.simulate.run import Run
from flighttune.units import FT

METRES = {"M": 1.0, "FT": FT}


def span_of(run: Run) -> float:
    """Wing span of the aircraft flown, m.

    A plant that is no aircraft is drawn as the first one of its scenario; where there is none, or
    its file does not say, as the mesh is.
    """
    tables = run.provenance.scenario.get("plant") or []
    flown = run.provenance.aircraft
    names = [flown] if flown else []
    names += [table["aircraft"] for table in tables if table.get("aircraft")]
    return _span(names[0]) if names else SPAN


@cache
def _span(aircraft: str) -> float:
    try:
        folder = aircraft_folder(aircraft)
        model = tomllib.loads((folder / "aircraft.toml").read_text(encoding="utf-8"))["model"]
        for file in (folder / f"{model}.xml", *_of_jsbsim(model)):
            if file.is_file():
                found = ElementTree.parse(file).find("metrics/wingspan")
                if found is not None and found.text:
                    return float(found.text) * METRES[found.get("unit", "FT")]
    except (InputError, OSError, ValueError, KeyError, ElementTree.ParseError):
        pass
    return SPAN


def _of_jsbsim(model: str) -> list[Path]:
    """The file of a model in JSBSim's own set, without loading JSBSim."""
    installed = find_spec("jsbsim")
    places = installed.submodule_search_locations if installed else None
    return [Path(place) / "aircraft" / model / f"{model}.xml" for place in places or []]
