"""Counts per flight hour that are killed go on to the same file; those of earlier counts go."""

import shutil
import tomllib

import numpy as np
import pytest
from flown_campaigns import Killer, seen_here
from fuzzing import in_child
from made_up_hours import fence_around, short_plan
from plans import item, plan_file, waypoint

import flighttune as ft
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.claims import counting, hourly_flights, leaving, per_hour, unfinished
from flighttune.claims.rates_keys import RatesTable
from flighttune.claims.unfinished_hours import KeptTerms

# The fewest flights that can support a claim of the band and its fence: 0.7^9 <= 0.1 / 2.
FEW = {"epsilon": 0.3, "confidence": 0.9, "flights": 9, "workers": 1}

# 24 flights: a term is written after 4, 5, ... of them.
RATES = """
flights = 12
[ending]
kind = "turn_back"
[[fault]]
kind = "engine"
per_hour = 1e-6
source = "a log"
flights = 6
[[fault]]
kind = "link_lost"
per_hour = 1e-5
source = "a log"
flights = 6
ended_s = 0.5
"""


class Seen(ft.CampaignObserver):
    """Keeps what is said, and the stages."""

    def __init__(self):
        self.said, self.stages = [], {}

    def see(self, progress):
        self.stages[progress.stage] = progress.doing

    def hear(self, sentence):
        self.said.append(sentence)


class MadeUp:
    """A made-up aircraft: every third flight leaves if it is ended over 2.5 s after its fault.

    Before flights of the search it keeps a copy of the file of unfinished flights, which is what a
    kill would leave then.
    """

    def __init__(self, file):
        self._file, self.flown, self.copies = file, 0, []

    def __call__(self, flights, pool, runs, doing):
        self.flown += len(runs)
        after = flights.leaving.after_s
        if after in per_hour.LATER_S and self._file.exists():
            self.copies.append((self.flown - len(runs), self._file.read_bytes()))
        late = after is not None and after > 2.5
        times = np.random.default_rng(runs).uniform(20.0, 24.0, (len(runs), 2)).tolist()
        return [
            leaving.Left(left if late and run % 3 == 0 else leaving.NEVER, end, leaving.NEVER, 0.0)
            for run, (left, end) in zip(runs, map(sorted, times), strict=True)
        ]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a mission of 15 s in a wide fence, its rates, and its whole count."""
    folder = tmp_path_factory.mktemp("hours")
    area = [[47.3, 8.4], [47.3, 8.6], [47.5, 8.6], [47.5, 8.4]]
    fence = {"version": 2, "circles": [], "polygons": [{"inclusion": True, "polygon": area}]}
    start = item(22, 15, 0, 0, None, 47.4, 8.5, 60)
    plan_file(folder / "m.plan", start, waypoint(47.403, 8.5, 60), geoFence=fence)
    (folder / "rates.toml").write_text(RATES)
    with seen_here():
        ft.mission(folder / "m.plan", out=folder / "m.npz", rates=folder / "rates.toml", **FEW)
    return folder


@pytest.mark.soak
def test_a_killed_count_per_hour_goes_on_and_is_the_same_to_the_bit(place, tmp_path, monkeypatch):
    """Killed within the first kind of flights, and after 14 more within the last one."""
    monkeypatch.setattr(unfinished, "FIRST", 4)
    file, said = tmp_path / "m-per-hour-unfinished.json", tmp_path / ".said"
    out, rates, seen = tmp_path / "m.npz", place / "rates.toml", Seen()

    def counted(observer):
        with seen_here():
            ft.mission(place / "m.plan", out=out, rates=rates, observer=observer, **FEW)

    last = "counting link lost, turn back after 0.5 s: their ends"
    for flown, doing in ((9, "counting healthy flight"), (14, last)):
        killer = Killer(said, flown, doing)
        assert in_child(lambda by=killer: counted(by), 60.0, 8 << 30) == "ended by SIGKILL"
        left = {x.name for x in tmp_path.glob("[!.]*")}
        assert left == {"m-unfinished.npz", file.name}  # no file of the answer
    assert said.read_text() == f"{file}: 9 flights are counted already."

    counted(seen)

    assert seen.said[-1] == f"{file}: 18 flights are counted already."
    assert [*seen.stages] == ["stage 1 of 2, ", "stage 2 of 2, "]
    names = {"m.npz", "m-per-hour.json"}
    assert {x.name for x in tmp_path.glob("[!.]*")} == names
    for name in names:
        assert (tmp_path / name).read_bytes() == (place / name).read_bytes()


@pytest.mark.soak
def test_a_new_count_without_rates_leaves_none_of_an_earlier_one(place, tmp_path):
    for name in ("m.npz", "m-per-hour.json"):
        shutil.copy(place / name, tmp_path)
    (tmp_path / "m-turn-back.npz").write_text("a file of somebody else")
    with seen_here():
        ft.mission(place / "m.plan", out=tmp_path / "m.npz", seed=3, **FEW)

    assert {x.name for x in tmp_path.glob("[!.]*")} == {"m.npz", "m-turn-back.npz"}


@pytest.mark.soak
def test_a_band_that_is_written_to_another_place_leaves_none_of_an_earlier_one(place, tmp_path):
    first, other = tmp_path / "first", tmp_path / "other"
    for folder in (first, other):
        folder.mkdir()
        shutil.copy(place / "m.npz", folder)
    shutil.copy(place / "m-per-hour.json", other)
    (other / "m-turn-back.npz").write_text("a file of somebody else")

    with seen_here():
        ft.mission(first / "m.npz", out=other / "m.npz", workers=1)

    assert {x.name for x in other.iterdir()} == {"m.npz", "m-turn-back.npz"}


def test_a_killed_search_of_the_latest_time_goes_on_and_is_the_same_to_the_bit(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(per_hour, "written_at", lambda flights: [flights // 2])
    fault = {"kind": "engine", "per_hour": 1.0, "source": "a log", "flights": 60, "ended_s": 0.2}
    stated = {"flights": 2000, "target_per_hour": 0.7, "fault": [fault]}
    plan = short_plan()
    file = tmp_path / "unfinished.json"

    def counted(name):
        made_up = MadeUp(file)
        monkeypatch.setattr(
            hourly_flights.TermFlights,
            "flown",
            lambda *args, again=False: [] if again else made_up(*args),
        )
        hourly = per_hour.count_per_hour(
            plan,
            RatesTable.model_validate(stated),
            fence=fence_around(1e4, plan, ends=(-1e4, 1e4)),
            confidence=0.95,
            unfinished=file,
            fliers=Fliers(workers=1),
        )
        hourly.save(tmp_path / name)
        return hourly, made_up

    whole, made_up = counted("whole.json")
    # Of the times 0.5, 1, 1.5, 2 and 3 s, the last is the first over 2.5 s.
    assert whole.latest == ("engine", 2.0)
    assert (made_up.flown, len(made_up.copies)) == (2060 + 5 * 60, 5 * 2)

    for kept, left in made_up.copies[1::4]:  # half of a time was flown
        file.write_bytes(left)
        _, rest = counted("rest.json")
        assert rest.flown == made_up.flown - kept
        assert (tmp_path / "rest.json").read_bytes() == (tmp_path / "whole.json").read_bytes()
        assert not file.exists()


@pytest.mark.parametrize("other", [{"flights": 13}, "cut", "open"])
def test_flights_of_another_count_are_not_gone_on_with(tmp_path, other):
    stated = ft.flights("circuit_in_wind").knowing(None)
    plan = counting.drawn(stated)
    volume = leaving.Volume(
        rings=(((0.0, 0.0), (0.0, 9.0), (9.0, 9.0)),), outside=(False,), low=None, high=9.0
    )

    def ends(**more):
        rates = RatesTable.model_validate({**tomllib.loads(RATES), **more})
        return hourly_flights.Ends(plan=plan, rates=rates, volume=volume, alarms=None)

    file, seen = tmp_path / "hours.json", Seen()
    healthy = {"fault": None, "ended_s": None}
    term = hourly_flights.FlownTerm(
        **healthy, left_s=(-1.0, 4.0), end_s=(9.0, 4.0), ended_at_s=(-1.0, -1.0)
    )
    KeptTerms(ends(), file, seen).keep(term)
    assert KeptTerms(ends(), file, seen).begun(**healthy) == term
    assert seen.said == [f"{file}: 2 flights are counted already."]

    if other == "cut":
        file.write_text(file.read_text()[:-9])
    if other == "open":
        file.chmod(0o666)  # anybody may have changed it
    kept = KeptTerms(ends(**({} if isinstance(other, str) else other)), file, seen)
    assert kept.flights == len(kept.begun(**healthy)) == 0
    assert seen.said[1].startswith(str(file))
    assert seen.said[1].endswith(": it is counted from the beginning.")
