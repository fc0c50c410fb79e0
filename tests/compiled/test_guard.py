"""When JSBSim flies itself, and the cache of compiled steps."""

import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from airframes import changed_aerosonde, of_this_model, off_nominal
from compiled_flights import why_not
from places import SHIPPED_AIRCRAFT

import flighttune as ft


def refused(folder):
    """What `trim` says of an aircraft that JSBSim flies."""
    return ft.trim(folder, V_a=[25.0], gamma=[0.0]).not_compiled


@pytest.fixture
def copies(tmp_path):
    """Copies of one aircraft that no other test has; a process knows nothing of a new folder."""
    names, mark = iter("abcdefgh"), f"<!-- {os.urandom(8).hex()} -->"

    def copy(file="", old="", new=""):
        name = next(names)
        folder = changed_aerosonde(tmp_path / name, lambda x: f"{x}{mark}" if not file else x)
        if file:
            path = folder / file
            path.write_text(path.read_text().replace(old, new))
            of_this_model(folder)
        return folder

    return copy


def steps_in(cache):
    return {x: x.stat().st_ino for x in cache.glob("*.step")}


def cut(file):
    file.write_bytes(file.read_bytes()[:-100])


def flipped(file, place=-50):
    data = bytearray(file.read_bytes())
    data[place] ^= 1
    file.write_bytes(data)


def open_to_others(file):
    file.chmod(0o622)


def linked(file):
    file.symlink_to(file.rename(file.with_suffix(".real")))


DAMAGES = [cut, open_to_others, linked, Path.unlink, flipped, lambda file: flipped(file, 40)]


@pytest.mark.parametrize(
    "damage",
    [pytest.param(x, marks=pytest.mark.counts) for x in DAMAGES[1:-1]]
    + [pytest.param(x, marks=pytest.mark.soak) for x in DAMAGES[::5]],
)
def test_a_step_is_made_anew_if_it_is_damaged_or_forged(damage, copies, empty_cache):
    assert refused(copies()) == ""
    (file,) = steps_in(empty_cache)
    kept = file.read_bytes()
    damage(file)

    assert refused(copies()) == ""
    assert not file.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o600
    assert file.read_bytes() == kept


CHANGES = [
    ("Engines/aerosonde_motor.xml", "36.576 <", "36.577 <"),
    ("aircraft.toml", "[engines]", "[engines]\nthrottle = [0.01, 1.0]"),
    ("aircraft.toml", "[surfaces]", "inner_loop_rate_hz = 250.0\n[surfaces]"),
]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(x, marks=pytest.mark.slow if x is CHANGES[0] else pytest.mark.counts)
        for x in CHANGES
    ],
)
def test_a_step_is_of_one_user_read_by_others_and_another_for_another_part_rate_or_throttle(
    change, copies, empty_cache
):
    text = (SHIPPED_AIRCRAFT / "aerosonde" / change[0]).read_text()
    assert change[1] in text
    own = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", empty_cache.parent / "own")
    assert refused(own) == ""
    ((file, made),) = steps_in(empty_cache).items()
    assert (empty_cache.stat().st_mode & 0o777, file.stat().st_mode & 0o777) == (0o700, 0o600)

    assert refused(shutil.copytree(own, own.with_name("again"))) == ""
    assert steps_in(empty_cache) == {file: made}
    assert refused(copies(*change)) == ""
    assert len(steps_in(empty_cache)) == 2


@pytest.mark.soak
def test_the_folder_of_steps_is_bounded_and_the_oldest_are_removed(copies, empty_cache):
    empty_cache.mkdir(parents=True, mode=0o700)
    for place in (empty_cache.parent, empty_cache):
        place.chmod(0o700)
    for n in range(450):
        (file := empty_cache / f"{n}.step").write_bytes(b"code")
        os.utime(file, (n, n))
    large = empty_cache / "449.step"
    os.truncate(large, 31_999_000)
    os.utime(large, (449, 449))

    assert refused(copies()) == ""

    left = [*empty_cache.iterdir()]
    assert len(left) <= 400
    assert sum(x.stat().st_size for x in left) <= 32_000_000
    assert not {large, empty_cache / "0.step"} & {*left}


@pytest.mark.soak
def test_a_cache_that_cannot_be_written_does_no_harm(copies, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))

    assert refused(copies()) == ""


@pytest.mark.soak
def test_a_step_is_made_once_though_several_processes_ask(copies, empty_cache):
    folder = copies()
    command = [sys.executable, "-m", "flighttune", "trim", folder, "--V-a", "25", "--gamma", "0"]
    asking = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]

    assert all("compiled" in one.communicate()[0] for one in asking)
    assert len(steps_in(empty_cache)) == 1


def test_on_other_platforms_jsbsim_flies(monkeypatch):
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")

    assert "aarch64" in refused("aerosonde")


@pytest.mark.slow
def test_a_difference_has_as_many_digits_as_tell_both_apart():
    said = r"^`\S+` differs first, in step \d+: (\S+) by JSBSim, (\S+) compiled"
    pair = re.search(said, refused(Path(__file__).parents[1] / "adopted/f16")).groups()

    digits = max(len(re.sub(r"e.*|\W", "", text).lstrip("0")) for text in pair)
    fewer = {f"{float(text):.{digits - 1}g}" for text in pair}
    assert len({*pair}) == 2
    assert digits <= 4 or len(fewer) == 1


def said_with(version, folder, aircraft):
    """What is said of an aircraft with a JSBSim that gives itself another version."""
    metadata = folder / f"jsbsim-{version}.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: jsbsim\nVersion: {version}\n")
    of_this = f"import flighttune as ft; x = ft.trim({str(aircraft)!r}, V_a=[150.0], gamma=[0.0])"
    done = subprocess.run(
        [sys.executable, "-c", f"{of_this}; print('said:', x.not_compiled)"],
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split("said:")[1].strip()


@pytest.mark.parametrize(
    ("aircraft", "wanted"),
    [
        pytest.param("a4", "", marks=pytest.mark.slow),
        pytest.param(
            Path(__file__).parents[1] / "adopted/f16",
            r"JSBSim 1\.4\.9 on linux \S+ glibc: `\S+` differs first, in step \d+: .*",
            marks=pytest.mark.counts,
        ),
    ],
)
def test_another_version_of_jsbsim_is_tried_and_named_where_it_differs(aircraft, wanted, tmp_path):
    assert re.fullmatch(wanted, said_with("1.4.9", tmp_path, aircraft))


# Aircraft that leave their envelope, touch the ground or have no flight where steps are checked.
ENDING = [
    ("alpha_deg", "[1.5, 3.2]", {}),
    ("alpha_deg", "[-1.0, 6.0]", {}),
    ("V_a_mps  ", "[24.7, 25.3]", {}),
    ("n_z      ", "[0.8, 1.2]", {}),
    ("theta_deg", "[1.0, 4.0]", {}),
    ("h_m      ", "3.0", {}),
    ("h_m      ", "1000.0", {"thrust_factor": 0.05}),
    ("h_m      ", "1000.0", {"lift_factor": 0.1, "mass_factor": 1.1, "cg_aft_m": 0.01}),
]


@pytest.mark.parametrize("air", [{"turbulence": "tustin"}, {"gust": True}])
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(x, marks=pytest.mark.slow if x is ENDING[2] else pytest.mark.soak)
        for x in ENDING
    ],
    ids=str,
)
def test_a_check_flight_that_ends_early_is_flown_otherwise(case, air, tmp_path, empty_cache):
    key, value, off = case
    folder = changed_aerosonde(tmp_path / "own", str)
    file = folder / "aircraft.toml"
    text, found = re.subn(f"(?m)^{key} .*=.*", f"{key} = {value}", file.read_text(), count=1)
    assert found
    file.write_text(text.replace("[20.0, 25.0, 30.0]", "[25.0]"))
    of_this_model(folder)

    assert why_not(folder, air, **off) == ""
    assert len(steps_in(empty_cache)) == 1


# A value of each key of a fault; two of them are times.
FAULT = {
    "from_s": 1.0, "ended_s": 2.0, "ended_by": "cut", "cg_aft_m": 0.01, "lift_factor": 0.8,
    "drag_factor": 1.5, "throttle_factor": 0.1, "actuator_lag_factor": 4.0, "V_a_bias_mps": 3.0,
    "aileron_stuck_deg": 5.0, "elevator_stuck_deg": -5.0, "rudder_stuck_deg": 5.0,
}  # fmt: skip


def test_every_key_of_a_fault_is_tried():
    assert FAULT.keys() == off_nominal(fault=FAULT).fault.model_dump().keys()


@pytest.mark.counts
@pytest.mark.parametrize("key", [*FAULT][3:])
def test_a_check_does_not_wait_for_what_comes_in_flight(key, copies):
    assert why_not(copies(), fault={"from_s": 1.0, key: FAULT[key]}) == ""


@pytest.mark.parametrize(
    "ended_by",
    [pytest.param("cut", marks=pytest.mark.soak), pytest.param("thrust", marks=pytest.mark.counts)],
)
def test_nor_for_what_ends(ended_by, copies):
    assert why_not(copies(), fault=FAULT | {"ended_by": ended_by}) == ""


# A leg so long and soft that it touches the ground in flight.
LEG = """<ground_reactions><contact type="BOGEY" name="leg">
    <location unit="M"> <x> 0.4 </x> <y> 0 </y> <z> -{} </z> </location>
    <static_friction>0.5</static_friction> <dynamic_friction>0.3</dynamic_friction>
    <spring_coeff unit="LBS/FT">1e-9</spring_coeff>
    <damping_coeff unit="LBS/FT/SEC">1e-9</damping_coeff>
</contact></ground_reactions>"""
SPRING = """<axis name="DRAG"><function name="a/spring"><product><value>1e-9</value>
    <property>gear/unit/compression-ft</property></product></function>"""


def on_a_leg(text, length):
    assert "<ground_reactions/>" in text
    text = text.replace('<axis name="DRAG">', SPRING)
    return text.replace("<ground_reactions/>", LEG.format(length))


@pytest.mark.parametrize(
    "low_first",
    [pytest.param(True, marks=pytest.mark.soak), pytest.param(False, marks=pytest.mark.counts)],
)
def test_a_difference_is_kept_for_the_case_it_was_seen_in_alone(low_first, tmp_path, empty_cache):
    """JSBSim moves the spring of a leg in a check that touches the ground, and in no other."""
    names = ("low", "high") if low_first else ("high", "low")
    said = {}
    for name in names * 2:  # in this process, and from the file
        folder = changed_aerosonde(tmp_path / f"{name}{len(said)}", lambda x: on_a_leg(x, 400))
        file = folder / "aircraft.toml"
        if name == "low":
            file.write_text(file.read_text().replace("h_m              = ", "h_m = 300.0 #"))
            of_this_model(folder)
        said[f"{name}{len(said)}"] = "gear/unit/compression-ft" in refused(folder)

    # A check that was equal stands for all numbers that none refused.
    assert not any(difference for name, difference in said.items() if name.startswith("high"))
    assert [x for name, x in said.items() if name.startswith("low")] == [low_first] * 2


@pytest.mark.counts
def test_five_cases_that_fail_are_tried_however_often_each_is_asked_for(tmp_path, empty_cache):
    folder = changed_aerosonde(tmp_path / "own", lambda x: on_a_leg(x, 2000))
    said = [why_not(folder, mass_factor=1.0 + 0.01 * k) for k in (1, 1, 1, 1, 1, 1, 2, 3, 4, 5, 6)]

    assert all("compression-ft" in why for why in said)
    assert [why.startswith("5 checks of other numbers failed") for why in said] == [
        *[False] * 10,
        True,
    ]
