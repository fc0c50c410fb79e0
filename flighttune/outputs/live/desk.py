"""Behind the page: flights with the values of the sliders, searches, and files to save."""

import json
import shlex
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from contextvars import copy_context
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

from flighttune.base.errors import FlightTuneError, InputError, StoppedError
from flighttune.base.files.table import toml_text
from flighttune.base.files.whole import together, write_text
from flighttune.base.stop import stopped_by
from flighttune.campaigns.engine.progress import CampaignObserver, CampaignProgress
from flighttune.campaigns.planning.knowing import Knowledge
from flighttune.campaigns.planning.plan import plan_campaign
from flighttune.campaigns.planning.source import Flights, airframes
from flighttune.claims.band import Band
from flighttune.claims.counted_flights import distribution_of
from flighttune.flight.fly import fly
from flighttune.flight.gains import tune
from flighttune.flight.loop.loop import compile_at_once
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.outputs.live.picture import Flown, pieces
from flighttune.outputs.live.sliders import (
    Slider,
    checked,
    gain_values,
    moved,
    sliders_of,
    with_one_gain_set,
)
from flighttune.routes.fence import Fence, fence_tables, read_fence

# Most flights in memory and ghosts of a page; aircraft of the button *20 aircraft*.
MAX_FLOWN, MAX_GHOSTS, AIRCRAFT = 12, 5, 20

# Longest wait for a stopped search to end, s.
END_S = 10.0

# Default budget of a search, flights.
BUDGET = 400

# Gains that a search found, by the keys of their sliders.
Found: TypeAlias = Mapping[str, float]


class Search(CampaignObserver):
    """A search that a page may stop; its state is replaced, never changed."""

    # The state tells every window what the search does and for which window, what is said of it,
    # the finished part, whether it is done or has failed, and values for the sliders of its window.
    def __init__(self, doing: str, window: str) -> None:
        self.doing, self.window, self.stopped = doing, window, False
        self.show("starting", 0.0)

    def show(self, said: str, part: float, **more: Any) -> None:
        """Say how far the search is, or how it ended."""
        told = {"doing": self.doing, "window": self.window, "said": said, "part": part}
        self.state: Mapping[str, Any] = told | more

    def see(self, progress: CampaignProgress) -> None:
        """Show the progress of flights."""
        done, runs = progress.part
        self.show(progress.sentence, min(done / max(runs, 1), 1.0))

    def go_on(self) -> None:
        """Raise a StoppedError if the page has stopped the search."""
        if self.stopped:
            raise StoppedError("the page stopped the search.")


class Desk:
    """A scenario with one gain set, its sliders, and what the buttons of the page do."""

    def __init__(
        self, flights: Flights, gains: str | None, folder: Path, budget: int = BUDGET,
        beside: Sequence[Run] = (),
    ) -> None:  # fmt: skip
        self.scenario, self.gains = with_one_gain_set(flights.scenario, gains)
        self.sliders: list[Slider] = sliders_of(self.scenario, self.gains)
        self.search = Search("", "")
        self._stated, self._folder, self._budget, self._beside = flights, folder, budget, beside
        self._fence = _fence_of(flights)
        self._flown = lru_cache(MAX_FLOWN)(self._fly)
        # The last cloud and the last corridor, each behind the values that it was flown with.
        self._cloud: tuple[str, list[Flown]] = ("", [])
        self._corridor: tuple[str, Band | None] = ("", None)
        self._flying, self._searching = threading.Lock(), threading.Lock()
        self._context = copy_context()  # the caller's permissions, and whether JSBSim flies
        compile_at_once()
        threading.Thread(target=self._fly_ahead, daemon=True).start()

    def _fly_ahead(self) -> None:
        """Fly the start before a browser asks for it: the first flight loads libraries."""
        with suppress(FlightTuneError), self._flying:  # the page shows the error when it asks
            self._context.copy().run(self._flights, {})

    def picture(self, asked: Mapping[str, Any]) -> dict[str, str]:
        """Pieces of the page after a move; its script asks for the next one after the answer."""
        with self._flying:
            return self._context.copy().run(self._pieces, asked)

    def _pieces(self, asked: Mapping[str, Any]) -> dict[str, str]:
        ghosts = [(str(x["name"]), x["values"]) for x in asked["ghosts"][:MAX_GHOSTS]]
        now, key = self._flights(asked["values"]), self._key(asked["values"])
        (of_cloud, cloud), (of_corridor, band) = self._cloud, self._corridor
        if band is not None and key == of_corridor:
            now = Flown(now.flights.within(band))
        named = {name: self._flights(values) for name, values in ghosts}
        return pieces(now, named, cloud if key == of_cloud else [], self._beside, self._fence)

    def _key(self, values: Mapping[str, Any]) -> str:
        return json.dumps(checked(self.sliders, values))

    def _flights(self, values: Mapping[str, Any]) -> Flown:
        """The flights with these values of the sliders, from memory if they are still there."""
        return self._flown(self._key(values))

    def _fly(self, key: str) -> Flown:
        return Flown(fly(moved(self.scenario, self.sliders, json.loads(key))))

    def begin(self, asked: Mapping[str, Any]) -> None:
        """Begin a search for a window; an InputError if another search is running."""
        doing, values = str(asked["doing"]), dict(asked["values"])
        work = {
            "tune": self._tune,
            "meet": self._meet,
            "aircraft": self._differ,
            "corridor": self._count,
        }[doing]
        scenario = moved(self.scenario, self.sliders, values)
        if not self._searching.acquire(blocking=False):
            raise InputError("another search is running: stop it first.")
        self.search = search = Search(doing, str(asked["window"]))

        def run() -> None:
            try:
                with stopped_by(search.go_on):
                    said, found = work(scenario, values, search)
                search.show(said, 1.0, done=True, values=found)
            except StoppedError:
                search.show("stopped; nothing has changed.", 1.0, done=True)
            except FlightTuneError as error:
                search.show(str(error), 1.0, done=True, failed=True)
            finally:
                self._searching.release()

        threading.Thread(target=self._context.copy().run, args=(run,), daemon=True).start()

    def stop(self, _asked: Mapping[str, Any] | None = None) -> None:
        """Stop the running search."""
        self.search.stopped = True

    def close(self) -> None:
        """Stop the running search, and wait until its processes have ended."""
        self.stop()
        if self._searching.acquire(timeout=END_S):
            self._searching.release()

    def _tune(self, scenario: Scenario, _: Any, _search: Search) -> tuple[str, Found]:
        result = tune(scenario)
        if result.gains is None:
            raise InputError(result.reason or "no gains meet the constraints.")
        return f"R_K is {result.R_K:.4g} 1/s.", gain_values(result.gains)

    def _meet(self, scenario: Scenario, _: Any, search: Search) -> tuple[str, Found]:
        from flighttune.studies.meet import meet  # here, so that the page opens quickly

        (entry,), law = scenario.gains, scenario.laws[0]
        gains = None if isinstance(entry, str) else entry.gains(law.kind)
        known = _navigation(scenario)
        meeting = meet(
            scenario, start=gains, budget=self._budget, navigation=known, observer=search
        )
        answer = meeting.answer()
        return f"{answer.verdict or answer.failure}", gain_values(meeting.gains)

    def _differ(
        self, scenario: Scenario, values: Any, search: Search
    ) -> tuple[str, dict[str, Any]]:
        """Fly aircraft that differ, one by one; moves of sliders are flown in between."""
        plan, flown = plan_campaign(airframes(scenario), runs=AIRCRAFT), list[Flown]()
        for number in range(AIRCRAFT):
            search.go_on()
            with self._flying:
                flown.append(Flown(fly(plan.scenario_of(number))))
            search.show(f"{number + 1} of {AIRCRAFT} have flown", (number + 1) / AIRCRAFT)
        self._cloud = self._key(values), flown
        varied = distribution_of(plan.campaign, plan.groups[0].plant).varied
        words = ", ".join(x.partition(" (")[0] for x in varied)
        return f"{AIRCRAFT} flights are drawn, varied as those of missions: {words}.", {}

    def _count(self, scenario: Scenario, values: Any, search: Search) -> tuple[str, Found]:
        """Count the corridor and the odds of leaving the fence of a mission, in the page's air."""
        from flighttune.claims.mission import mission

        drawn = replace(self._stated, scenario=scenario, campaign=airframes(scenario))
        odds = mission(drawn, navigation=_navigation(scenario), observer=search)
        self._corridor = self._key(values), odds.band
        return " ".join(odds.answer().summary[:2]), {}

    def save(self, asked: Mapping[str, Any]) -> dict[str, str]:
        """Write scenario and gains, or a recording, into a new folder inside the page's folder."""
        values = asked["values"]
        scenario = moved(self.scenario, self.sliders, values)
        self._folder.mkdir(parents=True, exist_ok=True)
        numbers = [int(x.name) for x in self._folder.iterdir() if x.name.isdecimal()]
        folder = self._folder / str(1 + max(numbers, default=0))
        folder.mkdir()
        if asked.get("recorded"):
            from flighttune.outputs.recording.record import record  # loads Rerun

            with self._flying:
                record(self._context.copy().run(self._flights, values).flights, folder)
            return {"said": "recorded", "command": f"flighttune view {shlex.quote(str(folder))}"}
        file = folder / "scenario.toml"
        with together():
            write_text(file, toml_text(_from_anywhere(scenario.as_dict())))
            (entry,) = scenario.gains
            if not isinstance(entry, str):
                entry.gains(scenario.laws[0].kind).save(folder / "gains.json")
        return {"said": "saved", "command": f"flighttune fly {shlex.quote(str(file))}"}


def _navigation(scenario: Scenario) -> Knowledge:
    """What the page flies: searches and counts would take a standard receiver on routes."""
    return scenario.navigation.grade if scenario.navigation else "exact"


def _fence_of(flights: Flights) -> Fence | None:
    """The fence of a mission, if it has one."""
    tables, route = fence_tables(flights.fences), flights.scenario.route
    return read_fence(flights.fences[0], route.origin, tables) if tables and route else None


def _from_anywhere(tables: dict[str, Any]) -> dict[str, Any]:
    """Tables of a scenario, with absolute paths of its files."""
    for table in (*tables.get("law", ()), *tables["plant"], tables["tuning"]):
        for key in ("module", "aircraft", "identified"):
            if key in table and Path(table[key]).name != table[key]:
                table[key] = str(Path(table[key]).absolute())
    return tables
