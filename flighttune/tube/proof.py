"""A tube as a file, and its check: every inclusion again, without the search that found it."""

import json
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.limits import Limits
from flighttune.errors import InputError
from flighttune.scenario.load import scenario_from
from flighttune.theory.certificate import Check, Verification
from flighttune.tube.exact import enclosure_of
from flighttune.tube.forms import Pieces
from flighttune.tube.hand_over import HandOver, for_ever, hull, inside, settled_from, way_round
from flighttune.tube.problem import TubeProblem
from flighttune.tube.replay import Replay
from flighttune.tube.result import (
    QUANTITIES,
    Settings,
    Tube,
    counted_bounds,
    first_set,
    tightest,
)
from flighttune.tube.sample import SampledLoop, Unbounded
from flighttune.whole_file import whole_file

FORMAT = "flighttune tube 3"
"""Readers refuse what they do not know."""

LIMITS = ("lower", "upper", "rate_lower", "rate_upper")

LOOSER = 1e-9
"""By how much, rad and 1, the bounds in a file are wider than proven: another machine may add up
in another order."""

MOST_PIECES, MOST_SYMBOLS, MOST_SAMPLES = 4096, 20000, 10000
"""Sizes above these are no tube's, and would only take up memory."""


def save_tube(tube: Tube, path: str | Path) -> None:
    """Write a bounded tube with its proof.

    Parameters
    ----------
    tube : Tube
    path : path-like
        File to write or replace.

    Raises
    ------
    InputError
        If the tube is not bounded.
    OutputError
        If the file cannot be written.
    """
    if tube.status != "bounded":
        raise InputError(
            f"`tube` must be bounded to be proven, got one that is not: {tube.reason}."
        )
    problem = tube.problem
    claim = {
        "format": FORMAT,
        "scenario": problem.scenario.as_dict(),
        "gains": problem.gains.as_lists(),
        "plant": problem.plant,
        "start_rad": problem.start,
        "lags": [asdict(lag) for lag in problem.lags],
        "start_known": problem.start_known,
        "basis": problem.basis,
        "law": problem.law,
        "settings": tube.settings._asdict(),
        "reason": tube.reason,
        "lost": tube.lost,
    }
    ever = tube.hand_over
    if ever is not None:
        claim["hand_over"] = {"sample": ever.sample, "samples": ever.samples}
    with whole_file(Path(path)) as part, part.open("wb") as file:
        np.savez_compressed(
            file,
            claim=np.array(json.dumps(claim)),
            d_low=problem.d_low,
            d_high=problem.d_high,
            reference=problem.reference,
            limits=np.array([getattr(problem.limits, name) for name in LIMITS]),
            bounds=tube.bounds + np.array([-LOOSER, LOOSER]),
            held=tube.held,
            chosen=tube.chosen,
            **({} if problem.roll is None else {"roll": problem.roll}),
            **({} if problem.counted is None else {"counted": problem.counted}),
            **({} if ever is None else _arrays(ever)),
        )


def _arrays(ever: HandOver) -> dict[str, Any]:
    loosened = ever.bounds + np.array([-LOOSER, LOOSER])
    arrays = {name: getattr(ever, name) for name in ("W", "centre", "size", "chosen")}
    return {f"ever_{name}": one for name, one in {**arrays, "bounds": loosened}.items()}


LIMITLESS = np.array([[-np.inf, np.inf]] * len(QUANTITIES))
"""Bounds on what nothing is enclosed of."""

DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError),
    *(MemoryError, OverflowError, RecursionError),
)
"""What a file that is damaged makes NumPy, `zipfile` and `json` raise, besides a ValueError."""


def is_tube_file(path: str | Path) -> bool:
    """Whether `path` is a file of the kind that `save_tube` writes."""
    return zipfile.is_zipfile(path)


def load_tube(path: str | Path) -> Tube:
    """Read a tube; nothing in it is trusted before `verify_tube` has checked it.

    Raises
    ------
    InputError
        If the file cannot be read or is no tube; the message names the file and what is wrong.
    """
    try:
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return _tube_from({name: arrays[name] for name in arrays.files})
    except OSError as error:
        raise InputError(f"{path}: the file must be readable: {error.strerror}.") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (*DAMAGE, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: the file must be a tube of flighttune: {error}.") from error


def _tube_from(arrays: dict[str, Any]) -> Tube:
    claim = json.loads(str(arrays["claim"]))
    if claim["format"] != FORMAT:
        raise InputError(f"`format` must be {FORMAT!r}, got {claim['format']!r}.")
    settings = Settings(**claim["settings"])
    if not (1 <= settings.sides**2 <= MOST_PIECES and 1 <= settings.symbols <= MOST_SYMBOLS):
        raise InputError(
            f"`settings` must have at most {MOST_PIECES} pieces and {MOST_SYMBOLS} symbols, got "
            f"{settings.sides**2} and {settings.symbols}."
        )
    scenario = scenario_from(claim["scenario"])
    problem = TubeProblem(
        scenario=scenario,
        gains=PIGains.from_lists(**claim["gains"]),
        plant=scenario.plant_table(claim["plant"]).label,
        start=float(claim["start_rad"]),
        d_low=arrays["d_low"],
        d_high=arrays["d_high"],
        reference=arrays["reference"],
        limits=Limits(**dict(zip(LIMITS, arrays["limits"], strict=True))),
        lags=tuple(InnerLag(**lag) for lag in claim["lags"]),
        roll=arrays.get("roll"),
        counted=arrays.get("counted"),
        start_known=claim["start_known"] is True,
        basis=str(claim["basis"]),
        law=str(claim["law"]),
    )
    bounds, held, chosen = (np.asarray(arrays[name]) for name in ("bounds", "held", "chosen"))
    shapes = (len(problem.t), len(QUANTITIES), 2), (len(problem.t), 2)
    if (bounds.shape, held.shape) != shapes or chosen.ndim != 1:
        raise InputError(f"`bounds` and `held` must have shapes {shapes}.")
    if held.dtype != bool or not (np.isfinite(bounds).all() and np.isfinite(chosen).all()):
        raise InputError("`bounds` and `chosen` must be finite, and `held` must be true or false.")
    lost = None if claim["lost"] is None else int(claim["lost"])
    if lost is not None and not (problem.counted is not None and 0 <= lost < len(problem.t)):
        raise InputError("`lost` must be a sample of a tube with errors that were counted.")
    return Tube(
        problem=problem,
        status="bounded",
        reason=str(claim["reason"]),
        t=problem.t,
        bounds=bounds.astype(float),
        held=held,
        settings=settings,
        chosen=chosen.astype(np.float32),
        hand_over=_hand_over(claim.get("hand_over"), arrays, problem),
        lost=lost,
    )


def _hand_over(
    counts: dict[str, int] | None, arrays: dict[str, Any], problem: TubeProblem
) -> HandOver | None:
    if counts is None:
        return None
    n = problem.loop.rows
    shapes = {"W": (n, n), "centre": (n,), "size": (n,), "bounds": (len(QUANTITIES), 2)}
    found = {name: np.asarray(arrays[f"ever_{name}"], dtype=float) for name in shapes}
    chosen = np.asarray(arrays["ever_chosen"]).astype(np.float32)
    if any(found[name].shape != shape for name, shape in shapes.items()) or chosen.ndim != 1:
        raise InputError(f"the arrays of the hand-over must have shapes {shapes}.")
    if not all(np.isfinite(one).all() for one in (*found.values(), chosen)):
        raise InputError("the numbers of the hand-over must be finite.")
    last = len(problem.t)
    sample, samples = int(counts["sample"]), int(counts["samples"])
    if not (settled_from(problem.loop) < sample <= last and 1 <= samples <= MOST_SAMPLES):
        raise InputError(
            f"the hand-over must be after the last change and by sample {last}, and take at most "
            f"{MOST_SAMPLES} samples, got sample {sample} and {samples} samples."
        )
    return HandOver(sample=sample, samples=samples, chosen=chosen, **found)


def verify_tube(
    tube: Tube | str | Path, *, progress: Callable[[float], None] | None = None
) -> Verification:
    """Prove every sample of a tube again from the choices in it.

    Parameters
    ----------
    tube : Tube or path-like
        The value, or the file it was written to.
    progress : callable, optional
        Called with the part that is checked, 0 to 1.

    Returns
    -------
    Verification
        Valid if at every sample the set proven is inside the bounds; else the reason names the
        sample and the inequality.

    Raises
    ------
    InputError
        If a file cannot be read or is no tube.
    """
    if not isinstance(tube, Tube):
        tube = load_tube(tube)
    problem = tube.problem
    enclosure = enclosure_of(problem.loop, first_set(problem, tube.settings), Replay(tube.chosen))
    margins, ever = np.full(len(QUANTITIES), np.inf), tube.hand_over
    counted = None if tube.lost is None else counted_bounds(problem)
    for k, t in enumerate(problem.t):
        ranges, held = LIMITLESS, np.ones(2, dtype=bool)
        if tube.lost is None or k < tube.lost:
            try:
                ranges, held = enclosure.sample(k)
            except (Unbounded, IndexError, InputError) as error:
                return _refused(f"sample {k} ({t:.2f} s): {error}")
        if counted is not None:
            ranges = tightest(ranges, counted[k])
        broken = _broken(ranges, tube.bounds[k])
        if broken:
            return _refused(f"sample {k} ({t:.2f} s): {broken}")
        if (held & ~tube.held[k]).any():
            name = ("phi_cmd", "n_z_cmd")[int(np.argmax(held & ~tube.held[k]))]
            return _refused(f"sample {k} ({t:.2f} s): that no limit holds {name} is not proven")
        room = (ranges - tube.bounds[k]) * [1.0, -1.0]
        margins = np.minimum(margins, room.min(axis=1))
        if ever is not None and k + 1 == ever.sample and not _reached(enclosure.pieces, ever):
            return _refused(f"sample {k + 1}: the set that is kept is not proven to be reached")
        if progress is not None and k % 50 == 0:
            progress(k / len(problem.t))
    if ever is not None and (broken := _not_kept(problem.loop, ever)):
        return _refused(f"after {ever.samples} samples from sample {ever.sample} on: {broken}")
    return Verification.of(
        [
            Check(
                name=f"{name} inside its bounds at {len(problem.t)} samples", margin=m, exact=True
            )
            for name, m in zip(QUANTITIES, margins, strict=True)
        ]
    )


def _reached(pieces: Pieces, ever: HandOver) -> bool:
    return inside(hull(pieces, ever.W), ever.centre, ever.size)


def _not_kept(loop: SampledLoop, ever: HandOver) -> str:
    """Why the set of a hand-over is not one that flights never leave; empty where it is."""
    try:
        found = way_round(loop, ever.W, ever.centre, ever.size, ever.samples, Replay(ever.chosen))
    except (Unbounded, IndexError, InputError, np.linalg.LinAlgError) as error:
        return str(error)
    if found is None:
        return "that no limit holds a command is not proven"
    after, passed = found
    bounds = for_ever(passed, len(loop.chi_ref) - ever.sample)
    return _broken(bounds, ever.bounds) or (
        "" if inside(after, ever.centre, ever.size) else "the set is not proven to be kept"
    )


def _broken(proven: FloatArray, claimed: FloatArray) -> str:
    for name, (low, high), (least, most) in zip(QUANTITIES, proven, claimed, strict=True):
        if not least <= low:
            return f"{name} >= {least:.9g} is not proven, but {name} >= {low:.9g}"
        if not high <= most:
            return f"{name} <= {most:.9g} is not proven, but {name} <= {high:.9g}"
    return ""


def _refused(reason: str) -> Verification:
    return Verification(valid=False, reason=reason, checks=())
