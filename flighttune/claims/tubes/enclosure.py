"""A tube: proven bounds for all flights of a problem, their claim, and their file."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, read_only_matrix, true_spans
from flighttune.base.errors import InputError, naming
from flighttune.base.files.array import (
    BOOL,
    FLOAT,
    SINGLE,
    TEXT,
    Arrays,
    check_shapes,
    read_arrays,
    write_sealed,
)
from flighttune.base.files.claim import current
from flighttune.base.files.load import is_sealed, sealed_bytes
from flighttune.base.files.table import STRICT, json_object, tables_of, value_of
from flighttune.base.signals import CHANNEL_SYMBOLS
from flighttune.base.units import DEG, DEG_PER_RAD
from flighttune.base.words import LEAST_WIDTH, at_least, at_most, confidence_text, quoted
from flighttune.claims.distribution import STARTS, flown_values
from flighttune.claims.residual import Residual
from flighttune.claims.tubes.problem import (
    QUANTITIES,
    AircraftBoxes,
    TubeProblem,
    reference_samples,
    sample_count,
    sample_times,
)
from flighttune.claims.tubes.proof import HandOver, replay, settled_from
from flighttune.claims.tubes.sample import start_set
from flighttune.control.gains import COMMANDS, PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.theory.exact import Verification
from flighttune.flight.conditions import start_condition
from flighttune.flight.entry import Entry
from flighttune.flight.loop.run import ERRORS, Bounds, Kind, Run, RunClaim, given_way
from flighttune.flight.scenario.load import scenario_from, scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.residual import RESIDUALS
from flighttune.vehicles.identification.file import changed_files, files_of
from flighttune.vehicles.plant_keys import PlantTable

# Reason if the problem's own flight leaves the tube
LEFT = "a flight leaves the tube, so it is wrong and no file is written"

# Relative tolerance for numbers of a scenario that was written and read again.
ROUNDING = 1e-12

# Tolerance for the rounding of a start plus its range, rad.
ROUNDING_RAD = 1e-14

# Largest difference, in rad, 1 and rad/s, between a feasible reference in a file and the rebuilt
# reference. An optimiser makes it, and its last digits differ between machines: by up to 5.3e-9 for
# changes of inputs by 1e-14. The tolerance is 0.00006 deg; tubes are wider than 0.001 deg.
SAME_REFERENCE = 1e-6

# Margin, rad and 1, of the bounds in a file over the proven bounds, because another machine may add
# up in another order.
BOUND_MARGIN = 1e-9

# Words for a file whose seal is missing or wrong, and what to do
REMEDY = "proof of a tube", "prove it again with flighttune tube"

# Maximum numbers in a proof, which bound its time and memory; samples count per round.
MAX_PIECES, MAX_SYMBOLS, MAX_SAMPLES = 4096, 20000, 10000

# Keys of a flight of an aircraft that a tube encloses as they are, but for two.
ENCLOSED, IN_BOXES = ("flight.", "limits.", "controller."), ("flight.V_a_mps", "flight.h_m")

ALWAYS = {"claim": TEXT, "bounds": FLOAT, "held": BOOL, "chosen": SINGLE}
EVER = {"W": FLOAT, "centre": FLOAT, "size": FLOAT, "bounds": FLOAT, "chosen": SINGLE}

# Arrays that a file may have, and their types. Only `ALWAYS` are required; `EVER` belong to an
# invariant set.
MEMBERS = {**ALWAYS, "reference": FLOAT, "boxes": FLOAT} | {f"ever_{x}": EVER[x] for x in EVER}


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of an enclosure."""

    sides: Annotated[int, Field(ge=1, le=64)]  # pieces of the starts along each axis
    symbols: Annotated[int, Field(ge=1, le=MAX_SYMBOLS)]  # maximum symbols of a piece
    tolerance: float  # see `Search`
    most: Annotated[int, Field(ge=1, le=MAX_PIECES)]  # maximum pieces, see `Search`


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """Values that cannot be rebuilt from the scenario, besides the arrays."""

    scenario: dict[str, Any]
    gains: PIGains
    plant: str
    start_rad: float
    disturbance_rad_s: float | None
    law: str
    settings: Settings
    # First sample of the invariant set, and number of samples that map it into itself
    hand_over: tuple[int, Annotated[int, Field(ge=1, le=MAX_SAMPLES)]] | None
    # See `AircraftBoxes`; without lags and hash unless the plant is an aircraft
    lags: tuple[InnerLag, ...]
    band_sha256: str | None
    files: Mapping[str, str] = field(default_factory=dict)  # see `Tube`

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune tube 9"
    UNSEALED: ClassVar[str] = "flighttune tube 8"
    UNITS: ClassVar[Mapping[str, str]] = {
        "bounds": "lower and upper bounds of the errors (rad) and commands (rad, 1) by sample",
        "boxes": "bounds on the rates left over (rad/s) and the roll (rad) by sample",
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class CountedProbability:
    """The probability that a flight of the counted distribution leaves a tube or its boxes."""

    of: Literal["flight", "residual_rates"]  # the event in words
    at_most: float
    confidence: float

    _LEAVES: ClassVar[Mapping[str, str]] = {
        "flight": "a flight of the distribution counted leaves the tube",
        "residual_rates": (
            "the residual rates of a flight of the distribution counted leave their boxes"
        ),
    }

    @property
    def sentence(self) -> str:
        """The probability in words."""
        chance, sure = at_most(self.at_most), confidence_text(self.confidence)
        return f"{self._LEAVES[self.of]} with probability at most {chance}, confidence {sure}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """Flights that were flown against a tube; it claims nothing of those outside the boxes."""

    flights: int  # own flight, from the corners of the starts, and `drawn` from random starts
    drawn: int
    outside_boxes: int
    drawn_outside_boxes: int
    leave: int  # inside their boxes, but outside the tube

    @property
    def sentence(self) -> str:
        """What the flights of an aircraft did, in words."""
        n, covered = self.flights, self.flights - self.outside_boxes
        random = f" ({self.drawn} from random starts)" * bool(self.drawn)
        of_these = f" ({self.drawn_outside_boxes} from random starts)" * bool(self.drawn)
        return (
            f"of {n} flight{'s' * (n != 1)} flown against the tube{random}, {covered} stayed in "
            f"the boxes, and {self.leave} of these left the tube; {self.outside_boxes}{of_these} "
            "left the boxes, and the tube claims nothing of them"
        )


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube(Answering):
    """Bounds that hold for every flight of a problem: a proven claim.

    Attributes
    ----------
    problem : TubeProblem
        The enclosed flights.
    status : {"bounded", "unbounded"}
        Whether the bounds hold for the whole time.
    reason : str
        Time and cause if they do not.
    bounds : Bounds
        Bounds on the errors (rad) and the commands (rad and 1) as long as they hold. The errors
        stay between the straight lines from sample to sample, relative to a reference that is also
        linear between samples.
    can_limit : ndarray of bool, shape (k, 2)
        Whether a limit can hold the command of roll and of load factor.
    settings : Settings
        How the enclosure was made.
    chosen : ndarray of float32, shape (n,)
        Choices that shorten the proof: slopes, splits and removed symbols.
    hand_over : HandOver or None
        Invariant set of the flights; None if no such set was found.
    flown : Flown or None
        Flights that were flown against it; None for a tube from a file.
    files : mapping of str to str
        For a tube from a file: SHA-256 of the files of its aircraft or identified model, by name.

    Examples
    --------
    >>> tube = ft.tube("level_turn", "paper", changes={"flight.duration_s": 2.5})
    >>> flown = ft.fly(tube.problem.scenario).within(tube)
    >>> [claim.kind for claim in flown.runs[0].claims]
    ['proven']
    """

    problem: TubeProblem
    status: Literal["bounded", "unbounded"]
    reason: str
    bounds: Bounds
    can_limit: npt.NDArray[np.bool_]
    settings: Settings
    chosen: npt.NDArray[np.float32]
    hand_over: HandOver | None = None
    flown: Flown | None = None
    files: Mapping[str, str] = field(default_factory=dict)

    kind: ClassVar[Kind] = "proven"

    @property
    def half_widths(self) -> dict[str, dict[str, float | None]]:
        """Half-widths of both errors in deg: maximum, at the end, and at all later times."""
        widths = self.bounds.half_widths * DEG_PER_RAD
        ever = self.hand_over and 0.5 * DEG_PER_RAD * np.ptp(self.hand_over.bounds, axis=1)
        return {
            channel: {
                "max": float(widths[:, i].max()),
                "end": float(widths[-1, i]),
                "ever": None if ever is None else float(ever[i]),
            }
            for i, channel in enumerate(CHANNEL_SYMBOLS)
            if len(widths)
        }

    @property
    def sentence(self) -> str:
        """The claim in words: flights, bounds and assumptions."""
        problem = self.problem
        if self.status != "bounded":
            return f"nothing is claimed of the flights of {problem.model}: {self.reason}"
        widths = self.half_widths
        within = " and ".join(
            f"{symbol} within {at_most(max(widths[channel]['max'] or 0.0, LEAST_WIDTH), 2)} deg"
            for channel, symbol in CHANNEL_SYMBOLS.items()
        )
        starts = f"from starts within {at_least(problem.start * DEG_PER_RAD)} deg of its start"
        shaken = self._disturbed()
        if self.probability is not None or problem.aircraft_checked is not None:
            shaken = " and under any disturbance in the boxes of its file"
        words = (
            f"every flight of {problem.model} at {problem.scenario.airspeed_words} with these "
            f"gains, {starts if problem.start else 'from its start'}{shaken}, in "
            f"{problem.scenario.air}, keeps {within} of the middle of its tube; its maker calls "
            f"the scenario {quoted(problem.scenario.title)}"
        )
        if problem.aircraft_checked is False:
            words += "; that an aircraft keeps the boxes in the file is not checked"
        return words if self.probability is None else f"{words}; {self.probability.sentence}"

    def _disturbed(self) -> str:
        """The size below which every disturbance is within the bounds of both rates, in words."""
        low, high = self.problem.disturbances
        course, path = np.minimum(-low, high).min(axis=0).tolist()
        if not (course or path):
            return ""
        sizes = f"{at_least(course)} rad/s"
        if course != path:
            sizes += f" of {CHANNEL_SYMBOLS['chi']} and {at_least(path)} rad/s"
            sizes += f" of {CHANNEL_SYMBOLS['gamma']}"
        return f" and under any disturbance of at most {sizes}"

    def why_not(self, run: Run) -> str:
        """Why the tube does not cover a run; empty if the run is one of its flights."""
        problem, made = self.problem, run.provenance
        if self.status != "bounded":
            return f"the set is not bounded: {self.reason}"
        if changed := changed_files(self.files):
            return f"the files of {changed[0]} must be those that it was proven with"
        if len(run.signals) < 2:
            return f"it did not fly: {run.outcome}"
        if made.gains is None or made.law.kind != problem.law.kind:
            return f"its law must be {problem.law.name}, got {made.law.name}"
        if not np.array_equal(made.gains.K, problem.gains.K):
            return "its gains must be those of the tube, got others"
        if given_way(run.signals).any():
            return "speed had priority in it, which the model of the tube does not know"
        scenario = scenario_of(run)
        plant, counted = scenario.plant_table(made.plant), problem.band
        if (plant.kind, plant.aircraft) != (problem.table.kind, problem.table.aircraft):
            return f"its plant must be {problem.plant}, got {made.plant}"
        if counted is not None and (
            why := counted.flights.distribution.difference(scenario, plant)
        ):
            return why
        return self._difference(scenario, plant)

    def _difference(self, scenario: Scenario, plant: PlantTable) -> str:
        """Why flights of a scenario are not of the tube, besides the boxes; empty if they are."""
        problem = self.problem
        flown = flown_values(scenario, plant)
        enclosed = flown_values(problem.scenario, problem.table)
        for key in dict.fromkeys([*flown, *enclosed]):
            # Air and airframe, airspeed and height act by residual signals, which have boxes.
            boxed = not key.startswith(ENCLOSED) or key in IN_BOXES
            if problem.band is not None and boxed:
                continue
            if not self._allows(key, flown.get(key), enclosed.get(key)):
                return f"`{key}` must be {enclosed.get(key)!r}, got {flown.get(key)!r}"
        reference = reference_samples(scenario, plant)
        same = reference.shape == problem.reference.shape
        if not same or np.abs(reference - problem.reference).max() > SAME_REFERENCE:
            return "its reference must be that of the tube, got another"
        return ""

    def _allows(self, key: str, flown: Any, enclosed: Any) -> bool:
        """Whether the tube encloses a value of a scenario."""
        if flown == enclosed:
            return True
        if key in STARTS and isinstance(flown, float | int) and isinstance(enclosed, float | int):
            return abs(flown - enclosed) * DEG <= self.problem.start + ROUNDING
        if key == "disturbance.as_wind":
            return not flown
        if key.startswith("disturbance."):
            # A disturbance of any shape within the bound of its channel.
            bounds = self.problem.disturbances[1].max(axis=0)
            channel, _, quantity = key.removeprefix("disturbance.").partition("_")
            bound = dict(zip(CHANNEL_SYMBOLS, bounds, strict=True)).get(channel, 0.0)
            return quantity != "amplitude" or abs(flown or 0.0) <= bound
        # The reference is compared by its values.
        return key.startswith("reference.")

    def on(self, run: Run) -> RunClaim:
        """The bounds of both errors at the samples of a run."""
        return RunClaim(
            kind=self.kind,
            title=f"tube in {self.problem.scenario.air}",
            sentence=self.sentence,
            bounds=self.bounds.of(ERRORS).lasting(run.t),
            units=dict.fromkeys(ERRORS, "rad"),
            no_claim=self.no_claim(run),
        )

    def no_claim(self, run: Run) -> str:
        """Why the tube does not cover a flight of the scenario, by what it did; empty if it does.

        That an aircraft keeps the boxes of its residual signals is counted and not proven.
        """
        outside = self.problem.outside_boxes(run.signals, start_condition(scenario_of(run)))
        return outside and f"{outside}, and the tube is of flights inside the boxes"

    def verify(self) -> Verification:
        """Prove every sample again from the choices in the tube, without a search."""
        problem, settings = self.problem, self.settings
        starts = start_set(problem.loop, problem.start, settings.sides, settings.symbols)
        return replay(problem, starts, self.chosen, self.bounds, self.can_limit, self.hand_over)

    @property
    def handed_over(self) -> float | None:
        """Time from which the flights are in the invariant set, s."""
        dt = 1.0 / self.problem.scenario.controller.rate_hz
        return None if self.hand_over is None else self.hand_over.sample * dt

    @property
    def probability(self) -> CountedProbability | None:
        """Counted probability for an aircraft; None without its band, or for an unbounded tube.

        It covers flights if the tube has all counted starts and the flights differ in nothing else.
        Otherwise it covers only the residual rates, because most flights do not even start inside a
        tube from one start.
        """
        problem, band = self.problem, self.problem.band
        if band is None or self.status != "bounded":
            return None
        starts = band.flights.distribution.start_range(problem.scenario, problem.table)
        from_all = starts is not None and problem.start >= starts - ROUNDING_RAD
        return CountedProbability(
            of="flight" if from_all else "residual_rates",
            at_most=band.about.epsilon,
            confidence=band.confidence,
        )

    def held_intervals(self, channel: int) -> list[tuple[float, float]]:
        """Intervals, s, in which a limit can hold the command of a channel."""
        t = self.bounds.t.tolist()
        return [(t[first], t[end - 1]) for first, end in true_spans(self.can_limit[:, channel])]

    def save(self, path: str | Path) -> None:
        """Write the tube with its proof (.npz); an InputError if it is not bounded."""
        if self.status != "bounded":
            raise InputError(
                f"the tube must be bounded to be proven, got one that is not: {self.reason}."
            )
        problem, ever, boxes = self.problem, self.hand_over, self.problem.boxes
        claim = Claim(
            scenario=problem.scenario.as_dict(),
            gains=problem.gains,
            plant=problem.plant,
            start_rad=problem.start,
            disturbance_rad_s=problem.disturbance,
            law=problem.law.name,
            settings=self.settings,
            hand_over=None if ever is None else (ever.sample, ever.samples),
            lags=() if boxes is None else boxes.lags,
            band_sha256=None if boxes is None else boxes.band_sha256,
            files=self.files or files_of(problem.table.aircraft or problem.table.identified),
        )
        looser = np.array([-BOUND_MARGIN, BOUND_MARGIN])
        arrays = {
            "claim": np.array(json.dumps(tables_of(claim))),
            "bounds": self.bounds.pairs + looser,
            "held": self.can_limit,
            "chosen": self.chosen,
        }
        if problem.scenario.feasible:
            arrays["reference"] = problem.reference
        if boxes is not None:
            arrays["boxes"] = boxes.bounds.pairs
        if ever is not None:
            arrays |= {f"ever_{name}": getattr(ever, name) for name in EVER}
            arrays["ever_bounds"] = ever.bounds + looser
        write_sealed(path, arrays)


def bounds_of(t: FloatArray, pairs: FloatArray) -> Bounds:
    """Bounds on `QUANTITIES` from lower and upper bounds, shape (k, 4, 2)."""
    return Bounds(t, pairs[..., 0], pairs[..., 1], QUANTITIES)


def load_tube(path: str | Path, band: Residual | None = None) -> Tube:
    """Read a tube and rebuild its problem from the scenario in the file."""
    with naming(path):
        # A sealed file that was changed is refused before it is unpacked.
        if sealed := is_sealed(Path(path)):
            sealed_bytes(Path(path), *REMEDY)
        arrays = read_arrays(Path(path), "tube", MEMBERS)
        # Bounds and choices in the file are not trusted before `Tube.verify` has checked them. The
        # boxes of an aircraft come from the file and must agree with the `band`, if given.
        stated = json_object(str(arrays["claim"]), "`claim`")
        if not sealed and stated.get("format") == Claim.FORMAT:
            sealed_bytes(Path(path), *REMEDY)
        claim = value_of(current(stated, Claim), Claim)
        return _tube_from(claim, arrays, band)


def _tube_from(claim: Claim, arrays: Arrays, band: Residual | None) -> Tube:
    """The tube of a file; its arrays supply only boxes and a feasible reference."""
    scenario, gains = scenario_from(claim.scenario), claim.gains
    # Checked before any array over the scenario's time is made, since a file may state years.
    k = sample_count(scenario)
    shapes: dict[str, tuple[int, ...] | None] = {
        **dict.fromkeys(ALWAYS),
        "bounds": (k, len(QUANTITIES), 2),
        "held": (k, 2),
    }
    if scenario.feasible:
        shapes["reference"] = k, 6
    if claim.band_sha256 is not None:
        shapes["boxes"] = k, len(RESIDUALS), 2
    if claim.hand_over is not None:
        shapes |= dict.fromkeys(f"ever_{name}" for name in EVER)
    for name in arrays.keys() - shapes.keys():
        raise InputError(f"`{name}.npy` must not be in the file of this tube.")
    check_shapes("tube", arrays, shapes)
    if gains.K.shape != (2, 4):
        raise InputError(f"`gains` must have 2 rows and columns, got {gains.K_P.shape}.")
    # Gains on roll and load factor may name the law of rates that the scenario had.
    law, _ = scenario.law_of(f"{claim.law}:", gains if gains.inputs == COMMANDS else None)
    table = scenario.plant_table(claim.plant)
    reference = reference_samples(scenario, table)
    if scenario.feasible:
        if (off := float(np.abs(arrays["reference"] - reference).max())) > SAME_REFERENCE:
            raise InputError(
                f"`reference` must be that of the scenario to {SAME_REFERENCE:g} (rad, 1, rad/s), "
                f"got one that is off by {off:.3g}."
            )
        reference = read_only_matrix("reference", arrays["reference"])
    stored = None
    if claim.band_sha256 is not None:
        low, high = np.moveaxis(arrays["boxes"], 2, 0)
        if len(claim.lags) != 2 or not (low <= high).all():
            raise InputError("`boxes` must be lower and upper bounds, with two `lags`.")
        stored = AircraftBoxes(
            bounds=Bounds(sample_times(scenario), low, high, tuple(RESIDUALS)),
            lags=claim.lags,
            band_sha256=claim.band_sha256,
        )
    entry = Entry(scenario=scenario, plant=table, law=law, gains=gains, name=f"{law.name}:tube")
    problem = TubeProblem(
        entry=entry,
        start=claim.start_rad,
        disturbance=claim.disturbance_rad_s,
        band=band,
        reference=reference,
        stored=stored,
    )
    ever = None
    if claim.hand_over is not None:
        (sample, samples), n = claim.hand_over, problem.loop.rows
        shapes = {"W": (n, n), "centre": (n,), "size": (n,), "bounds": (len(QUANTITIES), 2)}
        check_shapes("tube", arrays, {f"ever_{name}": shapes[name] for name in shapes})
        if not settled_from(problem.loop) < sample < k:
            raise InputError(
                f"`hand_over` must be after the last change and before sample {k}, got sample "
                f"{sample}."
            )
        values = {name: arrays[f"ever_{name}"] for name in EVER}
        ever = HandOver(sample=sample, samples=samples, **values)
    return Tube(
        problem=problem,
        status="bounded",
        reason="",
        bounds=bounds_of(problem.t, arrays["bounds"]),
        can_limit=arrays["held"],
        settings=claim.settings,
        chosen=arrays["chosen"].ravel(),
        hand_over=ever,
        files=claim.files,
    )
