"""Behind the page: flights with the values of the sliders, searches, and files to save."""

import json
import shlex
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import copy_context
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, Field, FiniteFloat

from flighttune.base.errors import DifferenceError, FlightTuneError, InputError, StoppedError
from flighttune.base.files.whole import made_folder, together
from flighttune.base.stop import stopped_by
from flighttune.campaigns.engine.progress import CampaignObserver, CampaignProgress
from flighttune.campaigns.planning.knowing import Knowledge
from flighttune.campaigns.planning.plan import plan_campaign
from flighttune.campaigns.planning.source import Flights, airframes
from flighttune.claims.band import Band
from flighttune.control.gains import PIGains
from flighttune.flight.flown import FlownScenario
from flighttune.flight.fly import check_flown, fly, fly_unchecked
from flighttune.flight.gains import tune
from flighttune.flight.loop.loop import compile_at_once
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.load import save_scenario
from flighttune.flight.scenario.schema import Scenario
from flighttune.outputs.answers.finding import PartFinding
from flighttune.outputs.live.picture import MAX_FLOWN, MAX_GHOSTS, pieces, without_flights
from flighttune.outputs.live.sliders import (
    Values,
    gain_sliders,
    moved,
    sliders_of,
    with_one_gain_set,
)
from flighttune.routes.fence import fence_tables, read_fence

# Aircraft of the button *20 aircraft*, default budget of a search (flights), longest wait for a
# stopped search to end, and time without a move after which JSBSim repeats what is shown, s.
AIRCRAFT, BUDGET, END_S, REST_S = 20, 400, 10.0, 0.5

# What a search says at its end, and gains for the sliders of its window.
Found: TypeAlias = tuple[str, PIGains | None]

Sent: TypeAlias = dict[str, int | FiniteFloat | str]


class Asked(BaseModel):
    """What a window asks: values of the sliders that have moved, and what else a verb needs."""

    values: Sent
    ghosts: Annotated[dict[str, Sent], Field(max_length=MAX_GHOSTS)] = {}
    window: str = ""
    doing: Literal["tune", "meet", "aircraft", "corridor"] = "tune"
    recorded: bool = False


class Search(CampaignObserver):
    """A search that a page may stop; its state is replaced, never changed."""

    def __init__(self, doing: str = "", window: str = "") -> None:
        self.state: Mapping[str, Any] = {"doing": doing, "window": window}
        self.show("starting", 0.0)

    def show(self, said: str, part: float = 1.0, **more: Any) -> None:
        """Say how far the search is; or that it is `done`, has `failed`, and `values` it found."""
        self.state = {**self.state, "said": said, "part": part, **more}

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
        recorded: Sequence[Run] = (),
    ) -> None:  # fmt: skip
        self.scenario, self.gains = with_one_gain_set(flights.scenario, gains)
        self.sliders = sliders_of(self.scenario, self.gains)
        self.search = Search()
        self._stated, self._folder, self._budget, self._recorded = flights, folder, budget, recorded
        self._fence = None
        if (tables := fence_tables(flights.fences)) and (route := flights.scenario.route):
            self._fence = read_fence(flights.fences[0], route.origin, tables)
        self._flown = lru_cache(MAX_FLOWN)(self._fly)
        # The last cloud and the last corridor, by the values that they were flown with.
        self._clouds: dict[str, list[Run]] = {}
        self._corridors: dict[str, Band] = {}
        self._counted: dict[str, Sequence[PartFinding]] = {}
        self._flying, self._searching = threading.Lock(), threading.Lock()
        self.differs: DifferenceError | None = None  # then nothing on the page is right
        self._shown: FlownScenario | None = None
        self._moved, self._closed = threading.Event(), False
        compile_at_once()
        in_thread(self._fly_ahead)
        in_thread(self._check_compiled)

    def _fly_ahead(self) -> None:
        """Draw the start before a browser asks for it: the first flight loads libraries."""
        with suppress(FlightTuneError):  # the page shows the error when it asks
            self.picture(Asked(values={}))

    def _check_compiled(self) -> None:
        """Repeat in JSBSim what is shown and decides, whenever the sliders rest."""
        while not self.differs:
            self._moved.wait()
            while self._moved.is_set() and not self._closed:
                self._moved.clear()
                self._moved.wait(REST_S)
            if self._closed:
                return
            if (shown := self._shown) is not None:
                with self._ended_by_difference():
                    check_flown(shown)

    @contextmanager
    def _ended_by_difference(self) -> Iterator[None]:
        """Let a DifferenceError of the block end the page: it shows the error and nothing else."""
        try:
            yield
        except DifferenceError as error:
            self.stop()
            self.differs, self._shown, self._clouds, self._corridors = error, None, {}, {}
            self.search = Search("flights")
            self.search.show(str(error), done=True, failed=True, differs=True)

    def _go_on(self) -> None:
        """Raise the DifferenceError that has ended the page."""
        if self.differs is not None:
            raise self.differs

    def picture(self, asked: Asked) -> dict[str, str]:
        """HTML of the page after a move; its script asks for the next one after the answer."""
        with self._flying:
            if self.differs is not None:
                said = str(self.differs)
                return {"failed": said, "pieces": without_flights(said)}
            key = _key(asked.values)
            now = self._flown(key)
            if key in self._corridors:
                now = now.within(self._corridors[key])
            ghosts = {name: self._flown(_key(values)) for name, values in asked.ghosts.items()}
            cloud = self._clouds.get(key, [])
            self._shown = now
            self._moved.set()
            counted = self._counted.get(key, [])
            return {"pieces": pieces(now, ghosts, cloud, self._recorded, self._fence, counted)}

    def _fly(self, key: str) -> FlownScenario:
        return fly_unchecked(moved(self.scenario, self.sliders, json.loads(key)))

    def begin(self, asked: Asked) -> None:
        """Begin a search for a window; an InputError if another search is running."""
        self._go_on()
        work = getattr(self, f"_{asked.doing}")
        scenario = moved(self.scenario, self.sliders, asked.values)
        if not self._searching.acquire(blocking=False):
            raise InputError("another search is running: stop it first.")
        self.search = search = Search(asked.doing, asked.window)

        def run() -> None:
            try:
                with self._ended_by_difference(), stopped_by(search.go_on):
                    said, gains = work(scenario, asked.values, search)
                    values = {x.key: x.value for x in gain_sliders(gains)} if gains else {}
                    search.show(said, done=True, values=values)
            except StoppedError:
                search.show("stopped; nothing has changed.", done=True)
            except FlightTuneError as error:
                search.show(str(error), done=True, failed=True)
            finally:
                self._searching.release()

        in_thread(run)

    def stop(self, _: Asked | None = None) -> None:
        """Stop the running search."""
        self.search.stopped = True

    def close(self) -> None:
        """Stop the running search, and wait until its processes have ended."""
        self.stop()
        self._closed = True
        self._moved.set()
        if self._searching.acquire(timeout=END_S):
            self._searching.release()

    def _tune(self, scenario: Scenario, _: Values, _search: Search) -> Found:
        result = tune(scenario)
        if result.gains is None:
            raise InputError(result.reason or "no gains meet the constraints.")
        return f"R_K is {result.R_K:.4g} 1/s.", result.gains

    def _meet(self, scenario: Scenario, _: Values, search: Search) -> Found:
        from flighttune.studies.meet import meet  # here, so that the page opens quickly

        known = _navigation(scenario)
        meeting = meet(scenario, budget=self._budget, navigation=known, observer=search)
        answer = meeting.answer()
        return answer.verdict or answer.failure, meeting.gains

    def _aircraft(self, scenario: Scenario, values: Values, search: Search) -> Found:
        """Fly aircraft that differ, one by one; moves of sliders are flown in between."""
        plan, flown = plan_campaign(airframes(scenario), runs=AIRCRAFT), list[Run]()
        for number in range(AIRCRAFT):
            search.go_on()
            with self._flying:
                flown += fly(plan.scenario_of(number)).runs
            search.show(f"{number + 1} of {AIRCRAFT} have flown", (number + 1) / AIRCRAFT)
        self._clouds = {_key(values): flown}
        return f"{AIRCRAFT} aircraft have flown, varied as those of missions.", None

    def _corridor(self, scenario: Scenario, values: Values, search: Search) -> Found:
        """Count the corridor and the odds of leaving the fence of a mission, in the page's air."""
        from flighttune.claims.mission import mission

        drawn = replace(self._stated, scenario=scenario, campaign=airframes(scenario))
        odds = mission(drawn, navigation=_navigation(scenario), observer=search)
        self._corridors = {_key(values): odds.band} if odds.band else {}
        answer = odds.answer()
        self._counted = {_key(values): answer.findings}
        return " ".join(answer.summary[:2]), None

    def save(self, asked: Asked) -> dict[str, str]:
        """Write scenario and gains, or a recording, into a new folder inside the page's folder."""
        with self._flying:
            self._go_on()
            flown, saved = self._flown(_key(asked.values)), made_folder(self._folder).iterdir()
            last = max((int(x.name) for x in saved if x.name.isdecimal()), default=0)
            folder = made_folder(self._folder / str(last + 1))
            if asked.recorded:
                from flighttune.outputs.recording.record import record  # loads Rerun

                record(flown, folder)
                return {"command": shlex.join(["flighttune", "view", str(folder)])}
            file, gains = folder / "scenario.toml", flown.runs[0].provenance.gains
            with together():
                save_scenario(flown.scenario, file)
                if gains is not None:
                    gains.save(folder / "gains.json")
        return {"command": shlex.join(["flighttune", "fly", str(file)])}


def in_thread(work: Callable[[], None]) -> threading.Thread:
    """Begin `work` in a thread with what its caller may do, and whether JSBSim flies."""
    thread = threading.Thread(target=copy_context().run, args=(work,), daemon=True)
    thread.start()
    return thread


def _key(values: Values) -> str:
    return json.dumps(values, sort_keys=True)


def _navigation(scenario: Scenario) -> Knowledge:
    """What the page flies: searches and counts would take a standard receiver on routes."""
    return scenario.navigation.grade if scenario.navigation else "exact"
