"""No damage and no forgery is silent: a file is refused, or says what was written or is true."""

import json
import random
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pytest
from fuzzing import EDGES, TEXTS, damaged, digit_changed, holder_of, places_in
from made_up import shortened
from made_up_band import counted_boxes
from made_up_tubes import aircraft_scenario, all_stay, arrays_of, tube, tube_scenario

import flighttune as ft
from flighttune.base.files.array import write_sealed
from flighttune.base.files.table import tables_of
from flighttune.claims.tubes.enclosure import load_tube

SEED = 26
FEW, MANY = 10, 1000
"""Damages of each kind of file, and as many forgeries: with the other tests, and in counts."""

LONGEST_LINE = 10_000
WRONG = (ValueError, TypeError, LookupError, AttributeError, OverflowError, pa.ArrowException)
"""What making a file out of a forgery raises where there can be none."""

COUNTS = [pytest.param(FEW, marks=pytest.mark.slow), pytest.param(MANY, marks=pytest.mark.counts)]
PROVEN = tube_scenario(chi_err_deg=15.0, gamma_deg=15.0, duration_s=0.4)


class Kind(NamedTuple):
    """A kind of file that carries a result."""

    make: Callable[[Path], Path]  # writes one into a folder
    read: Callable[[Path], Any]  # what it says, as values that are equal only where every bit is
    # Changes what the file says and writes it with every sum and seal that anybody can compute.
    forge: Callable[[Path, random.Random], None] | None = None
    # whether a forged file says nothing but what is so
    true: Callable[[Path, Any], bool] = lambda *_: False


# What JSON says, changed in one place.


def changed_text(text, draw):
    """JSON with a digit changed, or one value replaced by one at an edge or of another type."""
    if draw.random() < 0.5:
        return digit_changed(text.encode(), draw).decode()
    tables = json.loads(text)
    *above, key = draw.choice(list(places_in(tables)))
    holder = holder_of(tables, (*above, key))
    holder[key] = draw.choice([*EDGES, *TEXTS, None, True, [], {}, [1.0], 0, -1, 10**400, 1e308])
    if isinstance(holder, dict) and draw.random() < 0.2:
        del holder[key]
    return json.dumps(tables, ensure_ascii=False)


def changed_rows(rows, draw):
    """Numbers over samples with one changed, not a number, two samples swapped, or one lost."""
    rows, at = rows.copy(), draw.randrange(len(rows))
    place = (at, *(draw.randrange(size) for size in rows.shape[1:]))
    match draw.choice(["factor", "plus", "last bit", "nan", "swap", "fewer", "more"]):
        case "factor":
            rows[place] *= draw.choice([0.0, -1.0, 0.5, 1.01])
        case "plus":
            rows[place] += draw.choice([1e-9, -1e-6, 1e-3])
        case "last bit":
            rows[place] = np.nextafter(rows[place], np.inf)
        case "nan":
            rows[place] = draw.choice([np.nan, np.inf])
        case "swap":
            other = draw.randrange(len(rows))
            rows[[at, other]] = rows[[other, at]]
        case "fewer":
            rows = np.delete(rows, at, axis=0)
        case _:
            rows = np.insert(rows, at, rows[at], axis=0)
    return rows


# Proofs of tubes: of the law, and of an aircraft with the band of its boxes.


def proven(folder):
    tube(PROVEN, ft.PAPER_GAINS, for_ever=False, disturbance=0.02).save(folder / "tube.npz")
    return folder / "tube.npz"


def proven_of_aircraft(folder):
    scenario = aircraft_scenario(duration_s=0.2)
    boxes = counted_boxes(scenario)
    boxes.save(folder / "boxes.npz")
    tube(scenario, ft.PAPER_GAINS, for_ever=False, band=boxes).save(folder / "tube.npz")
    return folder / "tube.npz"


def proven_in(path):
    """What is proven; InputError where it is not."""
    boxes = path.with_name("boxes.npz")
    loaded = load_tube(path, ft.load(boxes) if boxes.exists() else None)
    verification = loaded.verify()
    if not verification.valid:
        raise ft.InputError(f"{path}: {verification.reason}")
    problem = loaded.problem
    claim = [
        problem.scenario.as_dict(), problem.gains.as_lists(), problem.plant, problem.start,
        problem.disturbance, problem.law.name, loaded.probability, problem.model,
        loaded.handed_over,
    ]  # fmt: skip
    held = loaded.can_limit.tobytes()
    return repr(claim), loaded.bounds.pairs.tobytes(), held, problem.reference.tobytes()


def forge_proof(path, draw):
    arrays = arrays_of(path)
    name = draw.choice(["claim", "claim", "bounds", "bounds", *arrays])
    if name == "claim":
        arrays[name] = np.array(changed_text(str(arrays[name]), draw))
    elif draw.random() < 0.1:
        del arrays[name]
    elif not arrays[name].size:
        arrays[name] = np.zeros(3, arrays[name].dtype)
    elif arrays[name].dtype == bool:
        at = draw.randrange(arrays[name].size)
        arrays[name].flat[at] = not arrays[name].flat[at]
    else:
        arrays[name] = changed_rows(arrays[name], draw).astype(arrays[name].dtype)
    write_sealed(path, arrays)


def no_flight_leaves(path, _):
    """Whether flights from the starts and under the disturbances claimed stay in the bounds."""
    found = load_tube(path)
    bound = max(found.problem.disturbances[1].max(), 0.0)
    return all_stay(found, bound, np.random.default_rng(SEED))


def its_flight_stays(path, _):
    from flighttune.claims.tubes.tube import flights_against

    return flights_against(load_tube(path)).leave == 0


# A run and a band have a SHA-256 of all they say: whoever forges one writes another result.


def recorded(folder):
    (file,) = ft.record(ft.fly(shortened("paper_as_printed", 1.0)), folder).signals.values()
    return file


def run_in(path):
    (run,) = ft.load(path).runs
    return repr(run.provenance), run.outcome, run.signals.to_numpy().tobytes()


def counted(folder):
    counted_boxes(aircraft_scenario(duration_s=0.2)).save(folder / "band.npz")
    return folder / "band.npz"


def band_in(path):
    band = ft.load(path)
    return repr(tables_of(band.about)), band.extremes.tobytes()


KINDS = {
    "run": Kind(recorded, run_in),
    "band": Kind(counted, band_in),
    "proof": Kind(proven, proven_in, forge_proof, no_flight_leaves),
    "proof of an aircraft": Kind(proven_of_aircraft, proven_in, forge_proof, its_flight_stays),
}


def outcome(kind, path, written):
    """What reading a file gives: a refusal in one line, the same as was written, or another."""
    try:
        said = kind.read(path)
    except ft.InputError as error:
        line = str(error)
        assert "\n" not in line
        assert len(line) < LONGEST_LINE
        return "refused", None
    return ("the same" if said == written else "another"), said


@pytest.fixture(scope="module")
def made(request, tmp_path_factory):
    """A kind of file, a folder, one of its files in it, and what that says."""
    kind, folder = KINDS[request.param], tmp_path_factory.mktemp("files")
    path = kind.make(folder)
    return kind, folder, path.relative_to(folder), kind.read(path)


def of_each(*kinds):
    """A test of kinds of files, with few and with many changes."""
    return lambda test: pytest.mark.parametrize("made", kinds, indirect=True)(
        pytest.mark.parametrize("count", COUNTS)(test)
    )


@pytest.mark.soak
@of_each("run", "band", "proof", "proof of an aircraft")
def test_no_damage_is_silent(made, count, tmp_path):
    (kind, folder, file, written), draw, seen = made, random.Random(SEED), Counter()
    whole = (folder / file).read_bytes()
    path = shutil.copytree(folder, tmp_path / "damaged") / file
    for _ in range(count):
        damage, data = damaged(whole, draw)
        path.write_bytes(data)

        result, _ = outcome(kind, path, written)

        assert result != "another", damage
        seen[f"{damage}: {result}"] += 1
    tell(file, seen)


@pytest.mark.soak
@of_each("proof", "proof of an aircraft")
def test_no_forgery_is_believed_unless_what_it_says_is_so(made, count, tmp_path):
    (kind, folder, file, written), draw, seen = made, random.Random(SEED), Counter()
    while seen.total() < count:
        shutil.rmtree(tmp_path / "forged", ignore_errors=True)
        path = shutil.copytree(folder, tmp_path / "forged") / file
        try:
            kind.forge(path, draw)
        except WRONG:  # there is no such file
            continue

        result, said = outcome(kind, path, written)

        if result == "another":
            assert kind.true(path, said), f"{path} says what is not so"
            result = "another, and it is so"
        seen[result] += 1
    tell(file, seen)


def tell(file, seen):
    """Write the counts, which ``pytest -rP`` shows."""
    for result, times in sorted(seen.items()):
        sys.stdout.write(f"{file}: {result}: {times}\n")
