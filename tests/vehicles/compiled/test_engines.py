"""Engines that few aircraft have, against JSBSim: small ones together, and a supercharger."""

import shutil
from pathlib import Path

import jsbsim
import numpy as np
import pytest
from airframes import of_this_model
from compiled_flights import differing, flown_by_both
from places import SHIPPED_AIRCRAFT

JSBSIM = Path(jsbsim.get_default_root_dir())

TURBOPROP = """<turboprop_engine name="turboprop"><maxpower unit="HP">0.025</maxpower>
    <psfc>0.6</psfc><idlen1>50</idlen1><maxn1>98</maxn1><n1idle_max_delay>0.7</n1idle_max_delay>
    <betarangeend>0</betarangeend><ielumaxtorque unit="FT*LB">{torque}</ielumaxtorque>
    <table name="EnginePowerVC"><independentVar>velocities/vc-kts</independentVar>
        <tableData> 30 0.5\n 60 1.1 </tableData></table>
    <table name="EnginePowerRPM_N1" type="internal"><tableData>
           50    80    100
        0  0.002 0.005 0.02
     2000  0.002 0.015 0.03
     9000  0.002 0.02  0.05 </tableData></table>
    <table name="ITT_N1" type="internal"><tableData> 0 1\n 0 0 0\n 100 300 700 </tableData></table>
    </turboprop_engine>"""
PROPELLER = """<propeller version="1.1"><ixx>0.0005</ixx><diameter unit="IN">12</diameter>
    <numblades>2</numblades><ct_factor>0.02</ct_factor>
    <table name="C_THRUST" type="internal">
        <tableData> 0.0 0.08\n 0.6 0.05\n 4.0 0.01 </tableData></table>
    <table name="C_POWER" type="internal">
        <tableData> 0.0 0.05\n 0.6 0.03\n 4.0 -0.5 </tableData></table></propeller>"""
# The speeds of its shafts are those that JSBSim takes.
JET = """<turbine_engine name="jet"><milthrust>0.08</milthrust><maxthrust>0.12</maxthrust>
    <bleed>0.02</bleed><augmented>1</augmented><augmethod>{method}</augmethod>
    <function name="IdleThrust"><value>0.1</value></function>
    <function name="MilThrust"><product><value>0.9</value>
        <property>atmosphere/sigma</property></product></function>
    <function name="AugThrust"><value>0.95</value></function></turbine_engine>"""
MOTOR = '<electric_engine name="motor"><power unit="WATTS">30</power></electric_engine>'
GOVERNED = """<propeller><ixx unit="KG*M2">0.0003</ixx><diameter unit="M">0.4</diameter>
    <numblades>2</numblades><gearratio>1.5</gearratio><ct_factor>0.02</ct_factor>
    <cp_factor>0.8</cp_factor><minpitch>5</minpitch><maxpitch>35</maxpitch>
    <minrpm>1500</minrpm><maxrpm>2500</maxrpm>
    <table name="C_THRUST" type="internal"><tableData>
             5    35
        0.0  0.08 0.12
        0.9  0.02 0.07
        2.5  0.01 0.02 </tableData></table>
    <table name="C_POWER" type="internal"><tableData>
             5    35
        0.0  0.05 0.12
        0.9  0.01 0.08
        2.5 -0.05 0.01 </tableData></table>
    <table name="CT_MACH" type="internal">
        <tableData> 0.1 1.0\n 0.3 0.8 </tableData></table>
    <table name="CP_MACH" type="internal">
        <tableData> 0.1 1.0\n 0.3 1.3 </tableData></table>
    </propeller>"""
NOZZLE = '<nozzle><area unit="IN2">0.0005</area></nozzle>'
ENGINES = (
    (TURBOPROP.format(torque=-1), PROPELLER),
    (TURBOPROP.format(torque=0.02), PROPELLER),
    (JET.format(method=1), "<direct/>"),
    (JET.format(method=2), NOZZLE),
    (MOTOR, GOVERNED),
)
# Off the axis, askew, and with a propeller that turns the other way.
ASIDE = """<location unit="M"><x>-0.1</x><y>0.2</y><z>-0.05</z></location>
    <orient unit="DEG"><roll>5</roll><pitch>4</pitch><yaw>-3</yaw></orient>
    <sense>-1</sense><p_factor>3</p_factor>"""
PLACE = '<location unit="M"><x>0.05888</x><y>0</y><z>0</z></location>'
# Levers follow the roll, from idle to beyond the end.
LEVER = """<fcs_function name="test/lever-{0}"><function><sum><value>0.5</value><product>
    <value>3</value><property>attitude/phi-rad</property></product></sum></function>
    <clipto><min>0</min><max>1.3</max></clipto>
    <output>fcs/throttle-pos-norm[{0}]</output></fcs_function>"""
TANK = f'<tank type="FUEL">{PLACE}<capacity>1</capacity><contents>0.1</contents></tank>'

# The aerodynamic reference point moves with the angle of attack; a part of the lift acts at the CG.
SHIFT = """<function name="aero_ref_pt_shift_x"><product><value>0.05</value>
    <property>aero/alpha-rad</property></product></function>"""
AT_CG = """<function name="test/at-cg" apply_at_cg="true"><product><value>0.02</value>
    <property>aero/qbar-area</property></product></function>"""

TWO_SPEEDS = """<numboostspeeds>2</numboostspeeds><takeoffboost unit="PSI">3</takeoffboost>
    <ratedboost1 unit="PSI">2</ratedboost1><ratedpower1>150</ratedpower1><ratedrpm1>2700</ratedrpm1>
    <ratedboost2 unit="PSI">2</ratedboost2><ratedpower2>150</ratedpower2><ratedrpm2>2700</ratedrpm2>
    <ratedaltitude1 unit="FT">500</ratedaltitude1><ratedaltitude2 unit="FT">20000</ratedaltitude2>
    </piston_engine>"""


def replaced(file, *changes):
    text = file.read_text("latin-1")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text, "latin-1")


@pytest.mark.slow
def test_turboprops_jets_with_afterburners_and_governed_propellers_are_those_of_jsbsim_to_the_bit(
    tmp_path,
):
    folder = tmp_path / "aircraft"
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
    numbered = dict(enumerate(ENGINES, 1))
    for n, (motor, thruster) in numbered.items():
        (folder / "Engines" / f"motor{n}.xml").write_text(motor)
        (folder / "Engines" / f"thruster{n}.xml").write_text(thruster)
    more = "".join(
        f'<engine file="motor{n}"><feed>0</feed><thruster file="thruster{n}">'
        f"{PLACE if n < 4 else ASIDE}</thruster></engine>"
        for n in numbered
    )
    levers = "".join(map(LEVER.format, numbered))
    replaced(
        folder / "aerosonde.xml",
        ("</propulsion>", f"{more}{TANK}</propulsion>"),
        ("</aerodynamics>", f"<aero_ref_pt_shift_x>{SHIFT}</aero_ref_pt_shift_x></aerodynamics>"),
        ('<axis name="LIFT">', f'<axis name="LIFT">{AT_CG}'),
        (
            "<aerodynamics>",
            f'<system name="levers"><channel name="levers">{levers}</channel></system>'
            "<aerodynamics>",
        ),
    )
    replaced(
        folder / "aircraft.toml",
        ("[engines]", '[settings]\n"propulsion/fuel_freeze" = 1.0\n\n[engines]'),
        ('command = "fcs/throttle-pos-norm"', f"count = {1 + len(ENGINES)}\nsettle_s = 12.0"),
    )
    of_this_model(folder)

    flown = flown_by_both(folder, 6.0)

    assert differing(flown) == []
    for n in numbered:
        lever, _ = flown[f"fcs/throttle-pos-norm[{n}]"]
        thrust, _ = flown[f"propulsion/engine[{n}]/thrust-lbs"]
        assert lever.min() < 0.6
        assert lever.max() > 1.0
        assert np.unique(thrust).size > 100
    # Functions that JSBSim looks for by name are shown below their engine.
    assert {f"propulsion/engine[{n}]/MilThrust" for n in (3, 4)} <= flown.keys()


@pytest.mark.slow
def test_a_supercharger_of_two_speeds_is_that_of_jsbsim_to_the_bit(tmp_path):
    folder = tmp_path / "aircraft"
    shutil.copytree(SHIPPED_AIRCRAFT / "c172p", folder)
    shutil.copy(JSBSIM / "aircraft/c172p/c172p.xml", folder)
    (folder / "Engines").mkdir()
    shutil.copy(JSBSIM / "engine/prop_75in2f.xml", folder / "Engines")
    shutil.copy(JSBSIM / "engine/eng_io320.xml", folder / "Engines")
    replaced(folder / "Engines/eng_io320.xml", ("</piston_engine>", TWO_SPEEDS))
    replaced(folder / "aircraft.toml", ('model  = "c172p"', 'model = "c172p.xml"'))
    of_this_model(folder)

    flown = flown_by_both(folder, 6.0)

    assert differing(flown) == []
    manifold, _ = flown["propulsion/engine/map-pa"]
    ambient, _ = flown["atmosphere/P-psf"]
    assert manifold.max() > 47.88 * ambient.max()  # Pa in a psf: no engine without one gets there
