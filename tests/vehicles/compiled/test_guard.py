"""The check flight, what is refused by name, and the cache of compiled steps."""

import os
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from airframes import changed_aerosonde
from places import SHIPPED_AIRCRAFT

from flighttune.base.files.table import toml_tables
from flighttune.vehicles.aircraft import aircraft
from flighttune.vehicles.compiled import cache, check, components, face, machine, rigid_body, run
from flighttune.vehicles.compiled.face import CompiledStep, Refusal, compiled
from flighttune.vehicles.compiled.model import Air, Source
from flighttune.vehicles.compiled.step import Names
from flighttune.vehicles.compiled.trace import sqrt


def textbook_quaternion(m):
    """The usual formula, in another order of operations than JSBSim's: off by rounding alone."""
    first = 0.5 * sqrt(1.0 + m[0][0] + m[1][1] + m[2][2])
    scale = 0.25 / first
    return [
        first,
        scale * (m[1][2] - m[2][1]),
        scale * (m[2][0] - m[0][2]),
        scale * (m[0][1] - m[1][0]),
    ]


def heavier(position, radius, planet, of=run.gravity):
    return of(position, radius, planet._replace(GM=planet.GM * (1.0 + 1e-15)))


def late_actuator(part, of=components._COMPONENTS["actuator"]):
    return part.delayed(of(part)) * (1.0 + 2.0**-52)


@pytest.mark.parametrize(
    "wrong",
    [
        (rigid_body, "quaternion_of", textbook_quaternion),
        pytest.param((run, "gravity", heavier), marks=pytest.mark.counts),
        pytest.param((components._COMPONENTS, "actuator", late_actuator), marks=pytest.mark.slow),
    ],
    ids=["quaternion", "gravity", "actuator"],
)
@pytest.mark.slow
def test_a_wrong_operation_is_found_and_jsbsim_flies(wrong, empty_cache, monkeypatch):
    place, name, operation = wrong
    setter = monkeypatch.setitem if isinstance(place, dict) else monkeypatch.setattr
    setter(place, name, operation)

    refusal = compiled(aircraft.load_aircraft("aerosonde"))

    assert isinstance(refusal, Refusal)
    said = r"^`\S+` differs first, in step \d+: (\S+) by JSBSim, (\S+) compiled"
    pair = re.search(said, refusal.reason).groups()
    # in as many digits as tell both apart, and in four at least
    digits = max(len(re.sub(r"e.*|\W", "", text).lstrip("0")) for text in pair)
    fewer = {f"{float(text):.{digits - 1}g}" for text in pair}
    assert len({*pair}) == 2
    assert digits <= 4 or len(fewer) == 1


def adding(function):
    """A change of a main file that adds a function to its drag."""

    def change(text):
        axis = '<axis name="DRAG">'
        assert axis in text
        return text.replace(axis, f'{axis}<function name="aero/more">{function}</function>')

    return change


def adding_component(component):
    def change(text):
        system = f'<system name="more"><channel name="more">{component}</channel></system>'
        return text.replace("<aerodynamics>", f"{system}<aerodynamics>")

    return change


PLACES = "".join(
    f"<{end}_{axis}>position/lat-geod-rad</{end}_{axis}>"
    for end in ("source", "target")
    for axis in ("latitude", "longitude")
)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (adding("<random/>"), r"does not know <random> in a function"),
        (
            adding_component(f'<waypoint_heading name="to">{PLACES}</waypoint_heading>'),
            r"does not know the component <waypoint_heading>",
        ),
        (
            adding_component(
                '<sensor name="s"><input>aero/alpha-rad</input>'
                '<noise variation="ABSOLUTE">0.1</noise></sensor>'
            ),
            r"does not know <noise> in <sensor>",
        ),
        (
            adding("<product><property>velocities/machU</property><value>1e-9</value></product>"),
            r"^`velocities/machU`, taken for constant, is moved by JSBSim",
        ),
    ],
    ids=["operator", "component", "part of a component", "property"],
)
def test_what_the_step_does_not_know_is_refused_by_name(tmp_path, change, reason):
    refusal = compiled(aircraft.load_aircraft(changed_aerosonde(tmp_path / "aircraft", change)))

    assert isinstance(refusal, Refusal)
    assert re.search(reason, refusal.reason)


def test_an_aircraft_without_a_design_is_checked_amid_its_envelope():
    config = aircraft.load_aircraft("aerosonde")
    low, high = config.envelope.V_a

    assert check._design(config) == (config.design.V_a, config.design.h)
    V_a, h = check._design(config.model_copy(update={"design": None}))
    assert (V_a, h) == (pytest.approx((low + high) / 2.0), 1000.0)


def test_on_other_platforms_jsbsim_flies(monkeypatch):
    monkeypatch.setattr(machine.platform, "machine", lambda: "aarch64")

    assert "got linux aarch64 glibc" in compiled(aircraft.load_aircraft("aerosonde")).reason


def test_other_versions_of_jsbsim_fly_themselves(monkeypatch):
    monkeypatch.setattr(face, "jsbsim_version", lambda: "1.3.9")

    assert compiled(aircraft.load_aircraft("aerosonde")).reason.endswith("version 1.3.3, got 1.3.9")


@pytest.mark.parametrize(
    "changes",
    [
        {"inner_loop_rate_hz": 100.0},
        {"engines": {"throttle": [0.1, 1.0]}},
        {"engines": {"thrust": "external_reactions/push/magnitude"}},
    ],
    ids=["rate", "lowest throttle", "thrust"],
)
def test_what_aircraft_toml_changes_of_a_step_is_in_its_key(changes):
    first = aircraft.load_aircraft("aerosonde")
    tables = toml_tables(first.file)
    engines = tables["engines"] | changes.get("engines", {})
    second = aircraft.aircraft_from(tables | changes | {"engines": engines}, first.folder)
    sources = [Source(config, 1) for config in (first, second)]

    assert sources[0] != sources[1]
    assert len({face._key(source, Air()) for source in sources}) == 2


def test_a_part_of_the_model_is_in_the_key_of_its_step(tmp_path):
    folders = [tmp_path / name for name in ("first", "copied", "changed")]
    for folder in folders:
        shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
    engine = folders[2] / "Engines" / "aerosonde_motor.xml"
    engine.write_text(engine.read_text().replace("36.576 <", "36.577 <"))

    sources = [Source(aircraft.load_aircraft(folder), 1) for folder in folders]
    first, copied, changed = (face._key(source, Air()) for source in sources)

    assert first == copied != changed
    names = [name for name, _ in sources[0].parts()]
    assert names == ["", "aerosonde_motor.xml", "direct.xml"]


def cut(file):
    file.write_bytes(file.read_bytes()[:-100])


def flipped(file, place=-50):
    data = bytearray(file.read_bytes())
    data[place] ^= 1
    file.write_bytes(data)


def of_another_key(file):
    kept = cache.kept_from(file.read_bytes(), file.stem)
    file.write_bytes(kept.bytes_for("0" * 64))


def open_to_others(file):
    file.chmod(0o622)


def linked(file):
    real = file.rename(file.with_suffix(".real"))
    file.symlink_to(real)


@pytest.mark.parametrize(
    "damage",
    [
        Path.unlink,
        cut,
        flipped,
        partial(flipped, place=40),
        of_another_key,
        open_to_others,
        linked,
        lambda file: file.write_bytes(b""),
    ],
    ids=["lost", "cut", "code", "names", "another key", "open", "a link", "empty"],
)
def test_a_damaged_or_forged_step_is_made_anew(damage, empty_cache):
    made = []

    def make():
        made.append(1)
        return cache.Kept(names=Names(*[("a",)] * 5), code=b"code" * 100)

    first = cache.kept_or_made("a" * 64, make)
    assert cache.kept_or_made("a" * 64, make) == first
    assert len(made) == 1
    damage(empty_cache / f"{'a' * 64}.step")

    assert cache.kept_or_made("a" * 64, make) == first
    assert len(made) == 2
    assert cache.kept_or_made("a" * 64, make) == first
    assert len(made) == 2


@pytest.mark.slow
def test_steps_are_the_users_alone_and_read_in_milliseconds(empty_cache):
    config = aircraft.load_aircraft("x8")
    assert isinstance(compiled(config), CompiledStep)
    (file,) = empty_cache.glob("*.step")
    assert (empty_cache.stat().st_mode & 0o777, file.stat().st_mode & 0o777) == (0o700, 0o600)
    face._known.cache_clear()
    written = file.stat().st_ino

    assert isinstance(compiled(config), CompiledStep)
    assert file.stat().st_ino == written


def test_a_cache_that_cannot_be_written_does_no_harm(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    kept = cache.Kept(names=Names(*[()] * 5), code=b"")

    assert cache.kept_or_made("a" * 64, lambda: kept) == kept


MAKE = """
import sys, time
from flighttune.vehicles.compiled.cache import Kept, kept_or_made
from flighttune.vehicles.compiled.step import Names

def make():
    print("made")
    time.sleep(0.3)
    return Kept(names=Names(*[()] * 5), code=b"")

kept_or_made("b" * 64, make)
"""


@pytest.mark.slow
def test_a_step_is_made_once_though_many_processes_ask(empty_cache):
    asking = [
        subprocess.Popen(
            [sys.executable, "-c", MAKE], stdout=subprocess.PIPE, text=True, env=os.environ
        )
        for _ in range(4)
    ]

    assert sorted(one.communicate()[0] for one in asking) == ["", "", "", "made\n"]


@pytest.mark.slow
def test_a_step_that_one_draw_cannot_check_is_checked_by_another(empty_cache):
    weak, strong = (
        aircraft.load_aircraft("aerosonde").with_off_nominal(
            aircraft.OffNominal(thrust_factor=factor)
        )
        for factor in (0.05, 0.9)
    )

    assert compiled(weak).reason.startswith("there is no flight to check it in: ")
    assert isinstance(compiled(strong), CompiledStep)
    assert isinstance(compiled(weak), CompiledStep)


@pytest.mark.slow
def test_a_step_that_no_draw_can_check_is_refused(empty_cache, monkeypatch):
    checked, check = [], face.check_flight
    monkeypatch.setattr(face, "check_flight", lambda *x: checked.append(x) or check(*x))
    for factor in (0.05, 0.04, 0.06, 0.03, 0.07, 0.08, 0.09):
        weak = aircraft.load_aircraft("aerosonde").with_off_nominal(
            aircraft.OffNominal(thrust_factor=factor)
        )

        assert compiled(weak).reason.startswith("there is no flight to check it in: ")
    assert len(checked) == face.MAX_UNCHECKED


# A value of each key of a fault; two of them are times.
FAULT = {
    "from_s": 1.0, "ended_s": 2.0, "ended_by": "cut", "cg_aft_m": 0.01, "lift_factor": 0.8,
    "drag_factor": 1.5, "throttle_factor": 0.1, "actuator_lag_factor": 4.0, "V_a_bias_mps": 3.0,
    "aileron_stuck_deg": 5.0, "elevator_stuck_deg": -5.0, "rudder_stuck_deg": 5.0,
}  # fmt: skip
FAULTS = {
    "all": FAULT,
    "ended by its thrust": FAULT | {"ended_by": "thrust"},
    **{key: {"from_s": 1.0, key: FAULT[key]} for key in [*FAULT][3:]},
    "ended at once": {"from_s": 300.0, "ended_s": 0.0},
    "engine, ended": {"from_s": 0.0, "throttle_factor": 0.1, "ended_s": 5.0},
}
IN_TEST = ("ended by its thrust", "engine, ended")


def test_every_key_of_a_fault_is_tried():
    assert FAULT.keys() == aircraft.Fault.model_fields.keys()


@pytest.mark.parametrize(
    "fault",
    [pytest.param(x, marks=pytest.mark.slow if x in IN_TEST else pytest.mark.soak) for x in FAULTS],
)
def test_a_check_does_not_wait_for_what_comes_in_flight(fault, empty_cache):
    off = aircraft.OffNominal(fault=aircraft.Fault(**FAULTS[fault]))
    config = aircraft.load_aircraft("aerosonde").with_off_nominal(off)

    assert isinstance(compiled(config), CompiledStep)


def flying_at(config, h):
    """The same model with another height of its design flight, in which it is checked."""
    return config.model_copy(update={"design": config.design.model_copy(update={"h": h})})


LEG = """<ground_reactions><contact type="BOGEY" name="leg">
    <location unit="M"> <x> 0.4 </x> <y> 0 </y> <z> -0.3 </z> </location>
    <static_friction>0.5</static_friction> <dynamic_friction>0.3</dynamic_friction>
    <spring_coeff unit="LBS/FT">10</spring_coeff>
    <damping_coeff unit="LBS/FT/SEC">1</damping_coeff>
</contact></ground_reactions>"""
SPRING = "<product><property>gear/unit/compression-ft</property><value>1e-9</value></product>"


def on_a_leg(text):
    assert "<ground_reactions/>" in text
    return adding(SPRING)(text.replace("<ground_reactions/>", LEG))


@pytest.mark.slow
@pytest.mark.parametrize("low_first", [True, False])
def test_a_difference_is_kept_for_the_case_it_was_seen_in_alone(low_first, tmp_path, empty_cache):
    """JSBSim moves the spring of a leg in a check near the ground, and in no other."""
    high = aircraft.load_aircraft(changed_aerosonde(tmp_path / "aircraft", on_a_leg))
    low = flying_at(high, 3.0)
    low_is_refused = []
    for config in (low, high) if low_first else (high, low):
        for _ in range(2):  # in this process, and from the file
            step = compiled(config)
            if config is high:
                assert isinstance(step, CompiledStep)
            else:
                low_is_refused.append("gear/unit/compression-ft" in getattr(step, "reason", ""))
            face._known.cache_clear()

    # A check that was equal stands for all numbers that none refused.
    assert low_is_refused == [low_first] * 2
    assert ("gear/unit/compression-ft" in getattr(compiled(low), "reason", "")) == low_first


def test_the_folder_of_steps_is_bounded_and_its_oldest_by_use_are_removed(empty_cache):
    def kept(key):
        made = cache.Kept(names=Names(*[("a",)] * 5), code=b"code")
        return cache.kept_or_made(key * 64, lambda: made)

    kept("a")
    kept("b")
    for n in range(cache.MAX_FILES):
        (empty_cache / f"{n}.step").write_bytes(b"code")
    ages = [("a", 3000), ("b", 2000), *((str(n), 1000) for n in range(cache.MAX_FILES))]
    for name, age in ages:
        file = empty_cache / f"{name * 64 if name in 'ab' else name}.step"
        os.utime(file, (file.stat().st_atime, file.stat().st_mtime - age))
    kept("a")
    kept("c")

    names = {file.stem[0] for file in empty_cache.glob("*.step") if len(file.stem) == 64}
    assert names == {"a", "c"}
    assert len([*empty_cache.iterdir()]) <= cache.MAX_FILES
    os.truncate(empty_cache / f"{'a' * 64}.step", cache.MAX_BYTES)
    kept("d")
    assert sum(file.stat().st_size for file in empty_cache.iterdir()) <= cache.MAX_BYTES
