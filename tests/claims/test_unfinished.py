"""Counts that are killed and go on: the same file, to the bit, with fewer flights."""

import shutil
import signal
import subprocess
import sys
from itertools import pairwise

import pytest
from made_up_missions import made_up_flights

import flighttune as ft
from flighttune.base.errors import StoppedError, keeping
from flighttune.claims import mission, unfinished

SHORT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 120.0)]}
SHORT |= {"gains": ["paper"], "law": ["paper"]}  # which need no search
FEW = {"epsilon": 0.3, "confidence": 0.9, "flights": 14, "changes": SHORT, "workers": 1}
LEARNED, FEW_LEARNED = 30, 10

# Killed by itself after so many flights; it writes those counted from the fourth on.
KILLED = f"""
import os, signal, sys
import flighttune as ft
from flighttune.claims import mission, unfinished
unfinished.FIRST, mission.LEARN = 4, {FEW_LEARNED}
class Killed(ft.CampaignObserver):
    def see(self, progress):
        if progress.flown >= int(sys.argv[2]):
            os.kill(os.getpid(), signal.SIGKILL)
ft.mission("circuit_in_wind", out=sys.argv[1], observer=Killed(), **{FEW!r})
"""


# Flights before those that are counted: learned from, and flown by RTK as well.
BEFORE = 2 * FEW_LEARNED


@pytest.fixture
def few_learned(monkeypatch):
    monkeypatch.setattr(mission, "LEARN", FEW_LEARNED)


class Seen(ft.CampaignObserver):
    """Keeps what is said, and the number of flights."""

    def __init__(self):
        self.said, self.flown = [], 0

    def see(self, progress):
        self.flown = progress.flown

    def hear(self, sentence):
        self.said.append(sentence)


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """The file of a count that was killed after 9 counted flights; no test changes it."""
    out = tmp_path_factory.mktemp("killed") / "killed.npz"
    done = subprocess.run([sys.executable, "-c", KILLED, out, str(BEFORE + 9)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert not out.exists()
    return out.with_name("killed-unfinished.npz")


class Stops(Seen):
    """Stops after so many flights."""

    def __init__(self, after):
        super().__init__()
        self.after = after

    def see(self, progress):
        super().see(progress)
        self.stopped = progress.flown >= self.after


@pytest.mark.soak
@pytest.mark.parametrize(("flown", "keeps"), [(BEFORE + 8, True), (FEW_LEARNED // 2, False)])
@pytest.mark.usefixtures("few_learned")
def test_a_stopped_count_names_the_file_with_which_it_goes_on(tmp_path, monkeypatch, flown, keeps):
    monkeypatch.setattr(unfinished, "FIRST", 4)
    kept = tmp_path / "m-unfinished.npz"

    with pytest.raises(StoppedError) as stopped:
        ft.mission("circuit_in_wind", out=tmp_path / "m.npz", observer=Stops(flown), **FEW)

    assert stopped.value.kept == ((str(kept),) if keeps else ())
    assert kept.exists() == keeps


@pytest.mark.soak
@pytest.mark.usefixtures("few_learned")
def test_a_killed_count_goes_on_and_is_the_same_to_the_bit(left, tmp_path):
    whole, out, seen = tmp_path / "whole.npz", tmp_path / "killed.npz", Seen()
    ft.mission("circuit_in_wind", out=whole, **FEW)

    kept = shutil.copy(left, tmp_path / left.name)
    ft.mission("circuit_in_wind", out=out, observer=seen, **FEW)

    # kept after 4, 5, ... 9 flights
    assert seen.said == [f"{kept}: 9 flights are counted already."]
    assert out.read_bytes() == whole.read_bytes()
    assert not kept.exists()
    # learned again, and the 5 others; those that decide are flown by JSBSim too
    again = ft.load(out).compiled.flown_again
    assert BEFORE + 5 <= seen.flown <= BEFORE + 5 + again


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({}, "9 flights are counted already."),
        ({"seed": 7}, "its flights belong to another count: it is counted from the beginning."),
        ("damaged", "must be a band file"),
        ("open", "must be a file of this user alone"),
    ],
)
def test_a_stopped_count_goes_on_with_its_flights_alone(tmp_path, monkeypatch, other, said):
    monkeypatch.setattr(unfinished, "FIRST", 4)
    out, kept, seen = tmp_path / "m.npz", tmp_path / "m-unfinished.npz", Seen()
    made_up_flights(monkeypatch, stopped_after=9)
    with pytest.raises(StoppedError) as stopped:
        ft.mission("circuit_in_wind", out=out, **FEW)
    assert stopped.value.kept == (str(kept),)
    assert [file.name for file in tmp_path.iterdir()] == [kept.name]
    if other == "damaged":
        kept.write_bytes(b"damaged")
    if other == "open":
        kept.chmod(0o666)  # anybody may have changed it

    flown = made_up_flights(monkeypatch)
    settings = FEW if isinstance(other, str) else FEW | other
    ft.mission("circuit_in_wind", out=out, observer=seen, **settings)

    (heard,) = seen.said
    assert heard.startswith(f"{kept}: ")
    assert said in heard
    assert heard.endswith("it is counted from the beginning.") == (other != {})
    begun = 9 if other == {} else 0
    assert flown == [*range(LEARNED + begun, LEARNED + 14)]
    assert [file.name for file in tmp_path.iterdir()] == [out.name]
    ft.mission("circuit_in_wind", out=tmp_path / "whole.npz", **settings)
    assert out.read_bytes() == (tmp_path / "whole.npz").read_bytes()


def test_little_of_a_long_count_is_lost_and_little_of_it_is_written():
    """The numbers kept of a flight are written at most 9 times over; an eighth may be lost."""
    for flights in (720, 7223, 72245):
        numbers = unfinished.written_at(flights)

        assert (numbers[0], unfinished.written_at(numbers[0])) == (250, [])
        assert all(later <= earlier * 1.125 + 1 for earlier, later in pairwise(numbers))
        assert flights / 1.126 < numbers[-1] < flights
        assert sum(numbers) < 9 * flights


@pytest.mark.parametrize("there", [(), ("flights",), ("flights", "room"), ("room",), ("hours",)])
def test_a_stopped_command_names_what_each_stage_keeps(tmp_path, there):
    """Three stages, of which the last is stopped; all stages are in one command."""
    flights, room, hours = (tmp_path / name for name in ("flights", "room", "hours"))
    for name in there:
        (tmp_path / name).write_text("kept")

    with pytest.raises(StoppedError) as stopped, keeping(flights, room), keeping(hours):
        raise StoppedError("stopped")

    assert {*stopped.value.kept} == {str(tmp_path / name) for name in there}
    assert stopped.value.lost == ("hours" not in there)
