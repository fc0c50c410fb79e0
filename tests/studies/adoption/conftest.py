"""A model of one's own to change, what experiments find of it, and what `adopt` says of it."""

import re
import shutil
from pathlib import Path

import pytest
from commands import flighttune
from places import SHIPPED_AIRCRAFT

from flighttune.studies.adoption.flightgear import stated_beside
from flighttune.studies.adoption.survey import survey, wide_tables

PROPELLER = """<propeller name="small"><ixx> {} </ixx><diameter unit="IN"> 16 </diameter>
<numblades> 2 </numblades><gearratio> 1 </gearratio>
<table name="C_THRUST" type="internal"><tableData>0 0.10
0.6 0.04
1.0 -0.05</tableData></table>
<table name="C_POWER" type="internal"><tableData>0 0.04
0.6 0.03
1.0 -0.01</tableData></table></propeller>"""


@pytest.fixture
def own(tmp_path):
    """A copy of the Aerosonde's model, and how to write it with changes or another motor."""
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "models/sonde")
    file, motor = folder / "aerosonde.xml", folder / "Engines/aerosonde_motor.xml"
    text = file.read_text()

    def write(*changes, power=None, ixx=None):
        new = text
        for pattern, change in changes:
            new, count = re.subn(pattern, change, new, count=1)
            assert count, pattern
        file.write_text(new)
        if power is not None:
            motor.write_text(re.sub("(<power.*?>)[^<]*", rf"\g<1> {power} ", motor.read_text()))
        if ixx is not None:
            (folder / "Engines/direct.xml").write_text(PROPELLER.format(ixx))
        return file

    return write


@pytest.fixture(scope="session")
def beside():
    """What the descriptions of FlightGear beside a main file state."""
    return stated_beside


@pytest.fixture(scope="session")
def surveyed(tmp_path_factory):
    """What a survey at 1000 m finds of a model, with FlightGear's files beside it."""

    def surveyed(model, told=lambda tables: None, **asked):
        tables, stated = wide_tables(str(model)), {}
        told(tables)
        if isinstance(model, Path):
            stated = {"stated": stated_beside(model)}
        return survey(tables, tmp_path_factory.getbasetemp(), h=1000.0, **stated, **asked)

    return surveyed


@pytest.fixture
def refusal(tmp_path):
    """What `adopt` says of what it refuses."""
    out = "--out", tmp_path / "mine"
    return lambda *asked, status=2: flighttune("adopt", *asked, *out, status=status)[1]
