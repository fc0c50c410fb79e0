"""Content of files, and checks of claims: certificates, bounds on R_K, tubes and bands."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from pathlib import Path
from typing import TypeAlias, TypeVar, Unpack

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.errors import InputError, naming
from flighttune.base.files import code
from flighttune.base.files.load import (
    A_LOG,
    AROUND_FLIGHTS,
    BAND,
    CLAIMS,
    LOG,
    READERS,
    is_sealed,
    kind_of,
    load_one,
)
from flighttune.base.words import listed
from flighttune.campaigns.dataset import Dataset
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.statistics.count import chance_missed, flights_again
from flighttune.claims import counted_flights, counting
from flighttune.claims.counted import Counted
from flighttune.claims.mission import check_hours
from flighttune.claims.monitor import LogMonitor
from flighttune.claims.per_hour import PerHour
from flighttune.claims.residual import Residual
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.tubes.problem import OF_RESIDUALS
from flighttune.control.certificates.bound import RateBound
from flighttune.control.certificates.certificate import Certificate
from flighttune.control.theory.exact import Check, Verification
from flighttune.flight.flown import FlownScenario
from flighttune.flight.loop.run import Run
from flighttune.flight.records.parquet import Recording
from flighttune.gaps.compare import Source
from flighttune.gaps.gap import Gap
from flighttune.logs.log import Columns
from flighttune.vehicles.identification.file import changed_files

CHECKED = (
    "claim (certificate, bound on R_K, tube, band or monitor), recording, or folder of a campaign"
)
CLAIM = "claim: the file of a certificate, a bound on R_K, a tube, a band or a monitor"
ABOUT_FLIGHTS = "claim about flights: the file of a tube, a band or a monitor"

CHOSEN = (
    "That its maker chose seed, signals, fences, numbers of flights or the rule that ends them, "
    "epsilon and confidence before a flight was counted is not checked: no file can show it."
)

NO_SEAL = (
    "The file has no SHA-256, like those of flighttune 0.5.0 and before: entries that no proof "
    "uses, such as names and notes, may have been changed."
)


def verified_band(
    band: Counted, *, count: int | None = None, run_code: bool = False, fliers: Fliers
) -> Verification:
    """Repeat all learning flights, and `count` of the counted flights at random."""
    counted, about = len(band.scores), band.about
    again = min(flights_again(about.epsilon), counted) if count is None else count
    draws, forged = counting.some_draws(band, again), math.ceil(about.epsilon * counted)
    try:
        plan = counted_flights.plan_of(band)
        files = plan.code
        if files and not run_code:
            reason = f"not checked: flying its flights again runs {listed(files)}; allow --run-code"
            return Verification(valid=False, reason=reason, checked=False)
        about.kind.measures.chosen(plan, about.signals)  # this refuses those that no flight has
        with WorkerPool(fliers) as pool:
            if differ := counting.differing(band, draws, pool):
                raise InputError(
                    "flights of the band that are flown again must be equal to the bit, draw "
                    f"{differ[0]} is not"
                )
            counting.check_shape(band, pool)
    except InputError as error:
        return Verification(valid=False, reason=str(error))
    flown = (
        f"All {about.learned} flights learned from were flown again and give the shape; {again} of "
        f"the {counted} counted, chosen at random, were flown again and are equal to the bit. A "
        f"forgery of {forged} counted flights, which would double epsilon, would be missed with "
        f"probability {chance_missed(forged, counted, again):.2g}."
    )
    return Verification(valid=True, reason="", notes=(flown, CHOSEN, *band.said_of_fences))


AnyClaim: TypeAlias = Certificate | RateBound | Tube | Counted | LogMonitor | PerHour
Loaded: TypeAlias = Recording | Dataset | Run | AnyClaim


def load(path: str | Path, *, columns: Columns = ()) -> Loaded:
    """Read a file that flighttune wrote, or a log; its content shows its kind.

    Claims are not proven again; `verify` does this. The scale of a band is computed again from its
    flights.

    Parameters
    ----------
    path : str or Path
        A recording (.rrd), its folder or the Parquet file of a run; the folder of a campaign; the
        file of a certificate, a bound on R_K, a tube, a band or a monitor; or the log of a real
        flight, ``LOG@START:END`` for a part of it in s.
    columns : mapping or sequence
        Columns of the signals in a log, as for `load_log`.

    Returns
    -------
    Recording, Dataset, Certificate, RateBound, Tube, Band, Monitor, LogMonitor or Run
        A log is a `Run`. A claim has a `sentence`.

    Raises
    ------
    InputError, RecordingError
        If the file does not exist, has another kind, or does not support its claim.

    Examples
    --------
    >>> ft.tube("level_turn", "paper", changes={"flight.duration_s": 2.5}).save("tube.npz")
    >>> ft.load("tube.npz").status
    'bounded'
    """
    if columns and kind_of(path) != LOG:
        raise InputError(f"{path}: `columns` must be absent for what is no log.")
    return load_one(path, "file that flighttune wrote, or a log", *READERS, columns=columns)


def load_residual(boxes: Residual | str | Path) -> Residual:
    """A count of residual signals, from a file or a value; InputError for another claim."""
    counted = load_one(boxes, "file of residual signals", BAND)
    if not isinstance(counted, Residual):
        place = f"{boxes}: " if isinstance(boxes, str | Path) else ""
        raise InputError(f"{place}{OF_RESIDUALS}, got a {type(counted).__name__}.")
    return counted


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verified(Answering):
    """A claim and its verification.

    Attributes
    ----------
    claim : Certificate, RateBound, Tube, Band, Residual, TurnBack, Monitor or LogMonitor
    verification : Verification
        Its checks, and the first failure.
    source : str
        The file of the claim; empty for a value.

    Examples
    --------
    >>> verified = ft.verify(ft.certify("paper", "paper").certificate)
    >>> verified.valid, all(check.exact for check in verified.checks)
    (True, True)
    """

    claim: AnyClaim
    verification: Verification
    source: str = ""

    @property
    def valid(self) -> bool:
        """Whether every check holds."""
        return self.verification.valid

    @property
    def reason(self) -> str:
        """The first check that fails; empty if all hold."""
        return self.verification.reason

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every inequality or inclusion of a proof, with its margin; empty for a band."""
        return self.verification.checks


@code.flies_again
def verify(
    claim: AnyClaim | Path | str,
    *,
    boxes: Residual | Path | str | None = None,
    logs: Sequence[Run | str | Path] = (),
    columns: Columns = (),
    count: int | None = None,
    run_code: bool = False,
    **by: Unpack[FlownBy],
) -> Verified:
    """Check a claim from its numbers alone.

    A certificate and a bound on R_K are checked in rational arithmetic without any solver, in
    seconds. A tube is proven again without the search that found it, in a fraction of its time.
    The claim of a band, also of a band for the boxes of a tube, is computed again from its plan and
    the numbers of each flight in its file. All learning flights are flown again, together with
    random counted flights and every suspicious copy. A band of 500 learning and 1640 counted
    flights takes a third of the time of its count. Weights, limits and scores of a monitor of logs
    are computed again from its file's numbers of each log, or from the logs.

    Parameters
    ----------
    claim : Certificate, RateBound, Tube, Band, Residual, TurnBack, Monitor, LogMonitor, str or Path
        A claim, or its file; the content shows its kind.
    boxes : Residual, str or Path, optional
        Residual signals that confirm the boxes of an aircraft's tube.
    logs : sequence of Run, str or Path
        All learning logs of a monitor of logs.
    columns : mapping or sequence
        Columns of the signals in these logs, as for `load_log`.
    count : int, optional
        Number of counted flights to repeat. By default invented flights that would double epsilon
        are found with a probability of 95 %: 59 flights at 5 % and 299 at 1 %. A note states the
        probability of missing them.
    run_code : bool
        Run the Python files that a band, a recording or a campaign names, to repeat its flights.
        Without it they are not flown, and such a band is not checked and not valid.
    workers, scheduler, observer : as for `band`

    Returns
    -------
    Verified
        `valid`, or the `reason` of a failure: the inequality, the sample or the flight.

    Raises
    ------
    InputError, RecordingError
        If a file cannot be read or is not a claim.

    Examples
    --------
    >>> ft.verify(ft.certify("paper", "paper").certificate).valid
    True
    """
    value, fliers = load_one(claim, CLAIM, *CLAIMS), Fliers(**by)
    source = str(claim) if isinstance(claim, str | Path) else ""
    if boxes is not None:
        if not isinstance(value, Tube):
            raise InputError("`boxes` must be given for the tube of an aircraft only.")
        value = replace(value, problem=replace(value.problem, band=load_residual(boxes)))
    if (logs or columns) and not isinstance(value, LogMonitor):
        raise InputError("`logs` and `columns` must be given for a monitor of logs only.")
    runs = tuple(load_one(x, A_LOG, LOG, columns=columns) for x in logs)
    again = Again(count=count, run_code=run_code, fliers=fliers, logs=runs, source=source)
    verification = verification_of(value, again)
    if source and not is_sealed(Path(source)):
        verification = replace(verification, notes=(*verification.notes, NO_SEAL))
    return Verified(claim=value, verification=verification, source=source)


@dataclass(frozen=True, slots=True, kw_only=True)
class Again:
    """Options for repeated flights and logs in the check of a claim."""

    count: int | None  # number of random counted flights
    run_code: bool
    fliers: Fliers
    logs: Sequence[Run] = ()
    source: str = ""  # file of the claim


@singledispatch
def verification_of(claim: Certificate | RateBound, again: Again) -> Verification:
    """The checks of a claim; a certificate or bound needs only its numbers."""
    del again
    return claim.verify()


@verification_of.register
def _of_count(claim: Counted, again: Again) -> Verification:
    return verified_band(claim, count=again.count, run_code=again.run_code, fliers=again.fliers)


@verification_of.register
def _of_logs(claim: LogMonitor, again: Again) -> Verification:
    return claim.verify(again.logs)


@verification_of.register
def _of_hours(claim: PerHour, again: Again) -> Verification:
    note = ""
    if claim.around is not None and again.source:
        try:
            note = check_hours(claim, Path(again.source))
        except InputError as error:
            return Verification(valid=False, reason=str(error))
    verification = claim.verify(again.count, again.fliers)
    return replace(verification, notes=(*verification.notes, *([note] if note else ())))


@verification_of.register
def _of_tube(claim: Tube, again: Again) -> Verification:
    verification, band = claim.verify(), claim.problem.band
    if band is None or not verification.valid:
        return verification
    return replace(_of_count(band, again), checks=verification.checks)


@singledispatch
def stale_notes(claim: AnyClaim) -> list[str]:
    """A sentence for aircraft or models whose files have changed since a proof was made."""
    del claim  # a bound covers any aircraft, and a band repeats its own flights
    return []


@stale_notes.register
def _of_files(claim: Certificate | Tube) -> list[str]:
    return [
        f"The files of {name} are no longer those that it was made with: it says nothing of {name} "
        "as it is now."
        for name in changed_files(claim.files)
    ]


# Types of flights that can have claims around them.
T = TypeVar("T", FlownScenario, Gap, Source)


def within(flights: T, files: Sequence[str | Path]) -> T:
    """Flights with the claims from files around them; InputError names the file."""
    for file in files:
        with naming(file):
            flights = flights.within(load_one(file, ABOUT_FLIGHTS, *AROUND_FLIGHTS))
    return flights
