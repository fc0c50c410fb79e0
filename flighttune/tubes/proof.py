"""A tube as a file, from which its proof can be checked."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from flighttune.arrays import read_only_matrix
from flighttune.claims.band import Band
from flighttune.control.gains import COMMANDS, PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.errors import InputError
from flighttune.files.array import BOOL, FLOAT, SINGLE, TEXT, Arrays, check_shapes, read_arrays
from flighttune.files.table import json_object
from flighttune.files.value import STRICT, tables_of, value_of
from flighttune.files.whole import whole_file
from flighttune.gaps.residual import RESIDUALS
from flighttune.identification.file import files_of
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario
from flighttune.simulate.bounds import Bounds
from flighttune.tubes.boxes import AircraftBoxes
from flighttune.tubes.enclosure import Settings, Tube, bounds_of
from flighttune.tubes.hand_over import HandOver, settled_from
from flighttune.tubes.problem import (
    QUANTITIES,
    SAME_REFERENCE,
    TubeProblem,
    reference_samples,
    sample_count,
    sample_times,
)

# Margin, rad and 1, of the bounds in a file over those proven: another machine may add up in
# another order.
BOUND_MARGIN = 1e-9

# Sizes of all members and of a file above which it is not read: three and five times those of the
# largest tube known, of an aircraft in the paper's step.
MAX_BYTES, MAX_COMPRESSED = 128_000_000, 32_000_000

# Number of samples of a round above which a proof would only take up time
MAX_SAMPLES = 10000

ALWAYS = {"claim": TEXT, "bounds": FLOAT, "held": BOOL, "chosen": SINGLE}
EVER = {"W": FLOAT, "centre": FLOAT, "size": FLOAT, "bounds": FLOAT, "chosen": SINGLE}

# Arrays that a file may have, and their types; all but `ALWAYS` only where they are needed, those
# of `EVER` with a set that is kept.
MEMBERS = {**ALWAYS, "reference": FLOAT, "boxes": FLOAT} | {f"ever_{x}": EVER[x] for x in EVER}

_check_shapes = partial(check_shapes, "tube")


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
    # First sample of the set that is kept, and number of samples that map it into itself
    hand_over: tuple[int, Annotated[int, Field(ge=1, le=MAX_SAMPLES)]] | None
    # See `AircraftBoxes`; no lags and no hash where the plant is no aircraft
    lags: tuple[InnerLag, ...]
    band_sha256: str | None
    files: Mapping[str, str] = field(default_factory=dict)  # see `Tube`

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune tube 8"
    UNITS: ClassVar[Mapping[str, str]] = {
        "bounds": "lower and upper bounds of the errors (rad) and commands (rad, 1) by sample",
        "boxes": "bounds on the rates left over (rad/s) and the roll (rad) by sample",
    }


def save_tube(tube: Tube, path: str | Path) -> None:
    """Write a bounded tube with its proof; an InputError if it is not bounded."""
    if tube.status != "bounded":
        raise InputError(
            f"`tube` must be bounded to be proven, got one that is not: {tube.reason}."
        )
    problem, ever, boxes = tube.problem, tube.hand_over, tube.problem.boxes
    claim = Claim(
        scenario=problem.scenario.as_dict(),
        gains=problem.gains,
        plant=problem.plant,
        start_rad=problem.start,
        disturbance_rad_s=problem.disturbance,
        law=problem.law.name,
        settings=tube.settings,
        hand_over=None if ever is None else (ever.sample, ever.samples),
        lags=() if boxes is None else boxes.lags,
        band_sha256=None if boxes is None else boxes.band_sha256,
        files=tube.files or files_of(problem.table.aircraft or problem.table.identified),
    )
    looser = np.array([-BOUND_MARGIN, BOUND_MARGIN])
    arrays = {
        "claim": np.array(json.dumps(tables_of(claim))),
        "bounds": tube.bounds.pairs + looser,
        "held": tube.can_limit,
        "chosen": tube.chosen,
    }
    if problem.scenario.feasible:
        arrays["reference"] = problem.reference
    if boxes is not None:
        arrays["boxes"] = boxes.bounds.pairs
    if ever is not None:
        arrays |= {f"ever_{name}": getattr(ever, name) for name in EVER}
        arrays["ever_bounds"] = ever.bounds + looser
    with whole_file(Path(path)) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_tube(path: str | Path, band: Band | None = None) -> Tube:
    """Read a tube and rebuild its problem from the scenario in the file.

    Bounds and choices in it are not trusted before `Tube.verify` has checked them. The boxes of an
    aircraft are those of the file, and must be those of the `band`, if there is one. Raises
    InputError if the file cannot be read, is no tube, or has another reference or other boxes than
    those rebuilt; the message names the file and what is wrong.
    """
    try:
        arrays = read_arrays(Path(path), "tube", MEMBERS, MAX_BYTES, MAX_COMPRESSED)
        claim = value_of(json_object(str(arrays["claim"]), "`claim`"), Claim)
        return _tube_from(claim, arrays, band)
    except OSError as error:
        raise InputError(f"{path}: the file must be readable: {error.strerror}.") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _tube_from(claim: Claim, arrays: Arrays, band: Band | None) -> Tube:
    scenario = scenario_from(claim.scenario)
    # Before anything as long as the scenario is made: a file may state a duration of years.
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
    _check_shapes(arrays, shapes)
    problem = _problem(claim, scenario, arrays, band)
    return Tube(
        problem=problem,
        status="bounded",
        reason="",
        bounds=bounds_of(problem.t, arrays["bounds"]),
        can_limit=arrays["held"],
        settings=claim.settings,
        chosen=arrays["chosen"].ravel(),
        hand_over=_hand_over(claim, arrays, problem),
        files=claim.files,
    )


def _problem(claim: Claim, scenario: Scenario, arrays: Arrays, band: Band | None) -> TubeProblem:
    """The problem of the scenario; only boxes may come from the file, and a feasible reference."""
    gains = claim.gains
    if gains.K.shape != (2, 4):
        raise InputError(f"`gains` must have 2 rows and columns, got {gains.K_P.shape}.")
    # Files of gains on roll and load factor may name the law of rates that the scenario had.
    law, _ = scenario.law_of(f"{claim.law}:", gains if gains.inputs == COMMANDS else None)
    reference = reference_samples(scenario, scenario.plant_table(claim.plant))
    if scenario.feasible:
        off = float(np.abs(arrays["reference"] - reference).max())
        if off > SAME_REFERENCE:
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
    return TubeProblem(
        scenario=scenario,
        gains=gains,
        plant=scenario.plant_table(claim.plant).label,
        start=claim.start_rad,
        disturbance=claim.disturbance_rad_s,
        band=band,
        law=law,
        reference=reference,
        stored=stored,
    )


def _hand_over(claim: Claim, arrays: Arrays, problem: TubeProblem) -> HandOver | None:
    if claim.hand_over is None:
        return None
    sample, samples = claim.hand_over
    n, last = problem.loop.rows, len(problem.t)
    shapes = {
        "ever_W": (n, n),
        "ever_centre": (n,),
        "ever_size": (n,),
        "ever_bounds": (len(QUANTITIES), 2),
    }
    _check_shapes(arrays, shapes)
    if not settled_from(problem.loop) < sample < last:
        raise InputError(
            f"`hand_over` must be after the last change and before sample {last}, got sample "
            f"{sample}."
        )
    ever = {name: arrays[f"ever_{name}"] for name in EVER}
    return HandOver(sample=sample, samples=samples, **ever)
