"""Counts of flights: draws, scores, and the order statistic behind their claims."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray, check_between
from flighttune.base.errors import InputError
from flighttune.base.files.array import write_sealed
from flighttune.base.files.table import tables_of
from flighttune.base.words import confidence_text, listed, number, quoted
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.claims.about import About, Of, Over
from flighttune.claims.distribution import Distribution
from flighttune.claims.ending import Ending, Shared
from flighttune.claims.measured import Measured
from flighttune.claims.shape import Extremes, predicted, scores_of
from flighttune.control.gains import PIGains
from flighttune.control.law import split_name
from flighttune.flight.loop.run import Bounds, Kind, Run, along_route
from flighttune.flight.route import PlannedRoute, planned_route
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.aircraft.aircraft import files_hash
from flighttune.vehicles.plants.base import plant_label
from flighttune.vehicles.plants.jsbsim.model_files import wing_span

# Gains within this relative difference count as equal: tuning repeats to 1e-9.
SAME_GAINS = 1e-6

# The largest half-width after this share of the time is also printed: flights have settled.
LAST_QUARTER = 0.75


def flown_words(scenario: Scenario, plant: str, gains_name: str) -> str:
    """Plant and law in words, by their kinds."""
    table, law = scenario.plant_table(plant), scenario.law_table(gains_name)
    return f"{plant_label(table.kind, table.aircraft)} under the {law.kind} law"


def flights_sentence(
    distribution: Distribution, scenario: Scenario, plant: str, gains_name: str
) -> str:
    """Flights of a distribution in words, with names by their maker in quotation marks."""
    names = {"flights": distribution.title, "gains": gains_name}
    if scenario.plant_table(plant).name:
        names["plant"] = plant
    said = listed([f"the {what} {quoted(name)}" for what, name in names.items()])
    flown = flown_words(scenario, plant, gains_name)
    return f"{distribution.sentence(flown)}; its maker calls {said}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandFlights:
    """The flights of a band and its windows, which follow from its plan and are not in its file."""

    measured: Measured  # counted signals
    over: Over = "time"  # axis of the windows: time, or the distance along a route
    edges: FloatArray  # (windows + 1,), s or m
    distribution: Distribution
    scenario: Scenario  # the undispersed scenario
    central: Scenario  # the scenario at the median of all draws
    plant: str  # label
    gains_name: str
    gains: PIGains
    aircraft: Mapping[str, str]  # SHA-256 of the files of each aircraft, by name or folder

    @property
    def span(self) -> float | None:
        """The wing span of the aircraft, m; None where there is none or its model states none."""
        table = self.scenario.plant_table(self.plant)
        return None if table.aircraft is None else wing_span(table.config)

    @property
    def flown(self) -> str:
        """Plant and law in words, by their kinds."""
        return flown_words(self.scenario, self.plant, self.gains_name)

    @property
    def sentence(self) -> str:
        """The flights in words, with names by their maker in quotation marks."""
        return flights_sentence(self.distribution, self.scenario, self.plant, self.gains_name)

    @property
    def gains_notes(self) -> tuple[str, ...]:
        """A sentence if the gains were tuned for another aircraft or airspeed."""
        return self.scenario.gains_notes(self.plant, self.gains_name)

    @property
    def changed(self) -> list[str]:
        """Aircraft whose files have changed since the flights."""
        return [name for name, digest in self.aircraft.items() if files_hash(name) != digest]

    @property
    def navigated(self) -> bool:
        """Whether flights along a route have errors of navigation."""
        return self.over == "along" and self.central.navigation is not None

    @property
    def route(self) -> PlannedRoute:
        """The flown route; InputError without a route, or if an aircraft has changed."""
        if self.changed:
            raise other_files(self.changed)
        return planned_route(self.central)

    def flown_otherwise(self, plant: str, name: str, gains: PIGains | None) -> str:
        """Differences of a flight in plant, law and gains, in words; empty without any."""
        laws = [split_name(x)[0] for x in (name, self.gains_name)]
        if self.plant != plant:
            return f"plant is {plant}, counted on {self.plant}"
        if laws[0] != laws[1]:
            return f"law is {laws[0]}, counted on {laws[1]}"
        if gains is None or not np.allclose(self.gains.numbers, gains.numbers, rtol=SAME_GAINS):
            return f"its gains are not those counted on, {self.gains_name}"
        return ""

    def not_counted(
        self, scenario: Scenario, plant: str, name: str, but: tuple[str, ...] = ()
    ) -> str:
        """First difference of a scenario's flights from the counted flights; empty without any.

        `plant` and `name` are the labels of its plant and gains. Keys that begin with `but` may
        have any value.
        """
        if self.changed:
            return f"the files of {listed(self.changed)} are not those counted on"
        options, counted = (
            {k: v for k, v in of.law_table(label).model_dump(mode="json").items() if k != "name"}
            for of, label in ((scenario, name), (self.scenario, self.gains_name))
        )
        for key, value in options.items():
            if value != counted.get(key):
                return f"law.{key} is {value}, counted on {counted.get(key)}"
        return self.distribution.not_counted(scenario, scenario.plant_table(plant), but)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted(Answering):
    """Counted flights of a distribution, with a claim about the probability of a new flight.

    Its kinds `Band`, `Residual`, `TurnBack` and `Monitor` define the meaning of the signals.
    """

    about: About
    flights: BandFlights
    extremes: Extremes
    wind: FloatArray
    # (flights, 4) along a route, else (flights, 0): largest errors of navigation beside it and in
    # height, then its distances as seen, m
    navigation: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    endings: Sequence[Mapping[str, Any]] = ()
    compiled: CompiledFlights = field(default_factory=CompiledFlights)
    scores: FloatArray = field(init=False)
    scale: float = field(init=False)

    kind: ClassVar[Kind] = "counted"
    of: ClassVar[Of] = None
    measures: ClassVar[type[Measured]]
    title: ClassVar[tuple[str, str]] = "band", "half_widths"  # title of the table in an answer
    unlike: ClassVar[tuple[str, ...]] = ()  # keys that may differ in a covered flight
    beside_rtk: ClassVar[bool] = False  # whether it has `by_rtk`, of learning flights

    def __post_init__(self) -> None:
        about = self.about
        if about.of != self.of:
            raise InputError(
                f"`about.of` must be {self.of} of a {type(self).__name__}, got {about.of}."
            )
        if not self.navigation.shape[1]:
            object.__setattr__(self, "navigation", np.zeros((len(self.extremes), 0)))
        scores = scores_of(self.extremes, self.wind, about.coefficients, about.half)
        object.__setattr__(self, "scores", scores)
        object.__setattr__(self, "scale", self.ending.scale(scores))
        check_between(0.0, 1.0, confidence=self.confidence)

    @property
    def measured(self) -> Measured:
        """The counted signals."""
        return self.flights.measured

    @property
    def ending(self) -> Ending:
        """The rule that ends the count, and its supported claims."""
        return Ending.of(self.about)

    @property
    def shared(self) -> Shared:
        """The claims that share the count's confidence."""
        return self.ending.shared(self.about, len(self.extremes))

    @property
    def confidence(self) -> float:
        """Confidence of all claims together."""
        return self.shared.confidence

    @property
    def claims(self) -> bool:
        """Whether enough of its flights were completed."""
        return bool(np.isfinite(self.scale))

    @property
    def readings(self) -> tuple[int, ...]:
        """Numbers of flights, fixed beforehand, at which the count may be read."""
        return self.ending.readings(len(self.extremes))

    @property
    def decided(self) -> bool:
        """Whether the answer is certain, possibly before all planned flights."""
        return self.ending.decided(self._not_inside, len(self.scores))

    @property
    def allowed(self) -> int:
        """Allowed number of flights outside, of the counted or, if more, the planned flights."""
        return self.ending.allowed(len(self.scores))

    @property
    def nearness(self) -> list[FloatArray]:
        """How near each flight comes to leaving, by claim, shape (N,): the largest leave first."""
        return [self.scores]

    @property
    def _not_inside(self) -> list[int]:
        """Number of counted flights that are outside at any scale, for each claim."""
        return [self.not_completed]

    @property
    def first(self) -> int:
        """Planned number of flights; a smaller count claims nothing, unless its rule ends it."""
        return self.ending.flights

    @property
    def draws(self) -> npt.NDArray[np.int64]:
        """Draws of the counted flights."""
        return self.draws_of(len(self.extremes))

    def draws_of(self, flights: int) -> npt.NDArray[np.int64]:
        """Draws of a number of flights."""
        i = np.arange(flights)
        # One draw is skipped at each doubling of the planned number. A continued count therefore
        # has other flights than a count planned with this length, and cannot be mistaken for it.
        return self.about.learned + i + np.searchsorted(self.ending.numbers, i, side="right")

    @property
    def outside(self) -> int:
        """Number of counted flights outside."""
        return int(np.sum(self.scores > self.scale))

    @property
    def not_completed(self) -> int:
        """Number of counted flights that did not complete or count as incomplete."""
        return int(np.isinf(self.scores).sum())

    @property
    def lost(self) -> str:
        """Number of counted flights with infinite extremes, and the reason, in words."""
        off = " or flew behind their start or back along the route" * (self.flights.over == "along")
        return f"{self.not_completed} did not complete{off}"

    def why_not(self, run: Run) -> str:
        """Why the count does not cover a run; empty if the run could be one of its flights."""
        if not self.claims:
            return "nothing is claimed: too many of the flights counted were not completed"
        if run.status != "completed":
            return f"status is {run.status}, counted on completed"
        return self.flights.flown_otherwise(*flown_by(run)) or self.not_about(run)

    def not_about(self, run: Run) -> str:
        """How a run of its plant, law and gains differs from its flights, in words, or empty."""
        origin = run.provenance
        return self.flights.not_counted(
            scenario_of(run), origin.plant, origin.gains_name, self.unlike
        )

    @property
    def nearest(self) -> int:
        """Draw of the inside flight that is nearest to leaving."""
        return int(self.draws[np.argmax(np.where(self.scores <= self.scale, self.scores, -np.inf))])

    @property
    def _leaves(self) -> str:
        """The event of small probability, in words."""
        raise NotImplementedError

    @property
    def sentence(self) -> str:
        """The claim in words, with the flights that it is about."""
        ending = self.ending
        if not (ending.corridor and ending.complete(len(self.scores))):
            return self.claim_words
        return f"{self.claim_words}. All are flights of {self.flights.sentence}"

    @property
    def claim_words(self) -> str:
        """The claim in words, without its flights."""
        ending, flights = self.ending, len(self.scores)
        if not ending.corridor:
            return f"no corridor is claimed: {flights} flights were counted to answer the fence"
        if not ending.complete(flights):
            return (
                f"nothing is claimed: the count ended after {flights} of {ending.flights} flights, "
                f"when the answer was certain: {self.lost}, and at most {self.allowed} may"
            )
        if not self.claims:
            return (
                f"nothing is claimed: of {flights} fresh flights {self.lost}, and at most "
                f"{self.allowed} may"
            )
        sure = f"confidence {confidence_text(self.confidence)}{self.shared.words}"
        return (
            f"a new flight {self._leaves} with probability at most "
            f"{number(ending.epsilon)}, {sure}: "
            f"{self.outside} of {flights} fresh flights did"
        )

    @property
    def said_of_fences(self) -> list[str]:
        """The claim about each fence in which the flights were counted."""
        return []

    def claiming(self, epsilon: float, confidence: float) -> Self:
        """The same count with another claim, which shares the confidence with the planned claim."""
        planned = self.about.planned or (self.about.epsilon, self.about.confidence)
        claim: dict[str, Any] = {"epsilon": epsilon, "confidence": confidence}
        claim["planned"] = None if planned == (epsilon, confidence) else planned
        return replace(self, about=replace(self.about, **claim))

    def with_flights(
        self,
        extremes: Extremes,
        wind: FloatArray,
        navigation: FloatArray,
        endings: Sequence[Mapping[str, Any]] = (),
    ) -> Self:
        """The count continued with more flights."""
        more = {"extremes": extremes, "wind": wind, "navigation": navigation}
        kept = {name: np.concatenate([getattr(self, name), x]) for name, x in more.items()}
        return replace(self, **kept, endings=[*self.endings, *endings])

    def _ends(self, wind: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds in this wind, (1, 2) or (1, 0), shape (windows, signals) each."""
        middle = predicted(wind, self.about.coefficients)[0]
        half = self.scale * self.about.half
        return middle - half, middle + half

    @property
    def sha256(self) -> str:
        """Hash of its file's content, independent of compression."""
        digest = hashlib.sha256(json.dumps(tables_of(self.about), sort_keys=True).encode())
        for array in (self.extremes, self.wind, self.navigation):
            digest.update(np.ascontiguousarray(array).data)
        return digest.hexdigest()

    def save(self, path: str | Path, **beside: str) -> None:
        """Write the count with its SHA-256 (.npz) and texts `beside` it, whole or not at all."""
        # First, because its `format` identifies the file.
        arrays: dict[str, Any] = {"band": np.array(json.dumps(tables_of(self.about)))}
        arrays |= {"extremes": self.extremes, "wind": self.wind}
        if self.navigation.shape[1]:
            arrays["navigation"] = self.navigation
        arrays |= self.own_arrays
        if self.compiled != CompiledFlights():
            arrays[COMPILED] = np.array(self.compiled.text)
        if self.endings:
            said = {str(x["run"]): "{status}: {reason}".format(**x) for x in self.endings}
            arrays["endings"] = np.array(json.dumps(said))
        write_sealed(path, arrays | {name: np.array(text) for name, text in beside.items()})

    @property
    def own_arrays(self) -> dict[str, FloatArray]:
        """Further arrays of its file."""
        return {}

    def sizes(self) -> list[dict[str, float]]:
        """A row of numbers for each signal, by column of `WIDTH_COLUMNS`, in SI."""
        raise NotImplementedError

    @property
    def own_notes(self) -> list[str]:
        """Sentences of an answer about the counted signals."""
        return []

    @property
    def own_values(self) -> dict[str, Any]:
        """Further values of an answer."""
        return {}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalBounds(Counted):
    """A count with bounds on signals, which a new flight leaves with some probability."""

    rounding: ClassVar[float] = 0.0  # s or m: positions of the bounds

    @property
    def half_widths(self) -> FloatArray:
        """Half the width of each window and signal, shape (windows, signals)."""
        return self.scale * self.about.half

    def bounds(self, t: FloatArray, wind: FloatArray | None = None) -> Bounds:
        """Bounds at times `t` (s) or distances along a route (m), in a `wind`, (2,)."""
        about = self.about
        if (about.predicted_from is None) != (wind is None):
            raise InputError(f"`wind` must be there for a band that is given it only, got {wind}.")
        window = np.searchsorted(self.flights.edges, np.add(t, self.rounding), side="right") - 1
        window = np.clip(window, 0, len(about.half) - 1)
        low, high = self._ends(np.zeros((1, 0)) if wind is None else np.reshape(wind, (1, 2)))
        return Bounds(np.asarray(t, dtype=float), low[window], high[window], tuple(about.signals))

    def sizes(self) -> list[dict[str, float]]:
        edges, rows = self.flights.edges, []
        late = edges[:-1] >= LAST_QUARTER * edges[-1]
        for widths in self.half_widths.T:
            last = widths[late].max(initial=0.0)
            rows.append({"largest": widths.max(), "last_quarter": last, "end": widths[-1]})
        if self.about.predicted_from is None:
            bounds = self.bounds(edges[:-1])
            for row, low, high in zip(rows, bounds.low.T, bounds.high.T, strict=True):
                row |= {"low": low.min(), "high": high.max()}
        return rows

    @property
    def own_notes(self) -> list[str]:
        note = "The band is around a middle that is predicted from the wind of each flight."
        return [note] if self.about.predicted_from else []


def other_files(aircraft: Iterable[str]) -> InputError:
    """The error for aircraft whose files have changed since the flights of a band."""
    return InputError(
        f"`{listed(list(aircraft))}` must have the files that the band was flown with, got changed "
        "ones."
    )


def flown_by(run: Run) -> tuple[str, str, PIGains | None]:
    """Plant, name of the gains, and gains of a run."""
    return run.provenance.plant, run.provenance.gains_name, run.provenance.gains


def axis_of(run: Run) -> FloatArray:
    """Time of each sample, or its distance along a route."""
    return along_route(run) if "along" in run.signals else run.t


def wind_at_start(scenario: Scenario) -> Sequence[float]:
    """North and east wind at the start, m/s."""
    if scenario.wind is None:
        return 0.0, 0.0
    return scenario.wind.profile().at(scenario.flight.h_m)[:2]
