"""Claims from files and their check: certificates, bounds on R_K, tubes and bands."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from flighttune.campaign.band import load_band, recount
from flighttune.campaign.counted_flights import plan_of
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.certificates.bound import RateBound, load_bound
from flighttune.certificates.certificate import Certificate, load_certificate
from flighttune.claims.band import Band, save_band
from flighttune.errors import InputError
from flighttune.files.seal import format_of
from flighttune.files.value import write
from flighttune.flight.flown import FlownScenario
from flighttune.gaps.gap import Gap
from flighttune.present.answer import Answer, Answering, pick
from flighttune.present.names import columns, listed
from flighttune.present.tables import Column, Table
from flighttune.records.compare import Source
from flighttune.theory.exact import Check, Verification
from flighttune.tubes.enclosure import Tube
from flighttune.tubes.proof import load_tube, save_tube

CLAIM_FILE = "claim: the file of a certificate, a bound on R_K, a tube or a band"
AROUND_FLIGHTS = "claim about flights: the file of a tube or a band"

# Flights of a band that are flown again.
FLOWN_AGAIN = 5

CHECK_COLUMNS = [Column("name", "check"), *columns("margin exact")]


def verified_band(
    band: Band, *, run_code: bool = False, pool: WorkerPool | None = None
) -> Verification:
    """Fly a few flights again, chosen at random; all must be equal to the bit."""
    flights = min(FLOWN_AGAIN, len(band.scores))
    flown = f"{flights} of its flights, chosen at random, were flown again: equal to the bit."
    try:
        code = plan_of(band).code
        fences = [band.inside(x).sentence for x in band.about.fences]
        if code and not run_code:
            flown = f"No flight was flown again: --run-code runs {listed(code)} for it."
        else:
            with nullcontext(pool) if pool else WorkerPool(1) as workers:
                differ = recount(band, flights, workers)
            if differ:
                raise InputError(
                    f"flights flown again must be equal to the bit, draw {differ[0]} is not"
                )
    except InputError as error:
        return Verification(valid=False, reason=str(error))
    notes = "The scale is that of the flights in the file.", flown, *fences
    return Verification(valid=True, reason="", notes=notes)


AnyClaim: TypeAlias = Certificate | RateBound | Tube | Band

# Readers of files of claims, by the `format` that they state.
READERS: dict[str, Callable[[Path], AnyClaim]] = {
    "flighttune certificate": load_certificate,
    "flighttune rate bound": load_bound,
    "flighttune tube": load_tube,
    "flighttune band": load_band,
}


def load_claim(path: str | Path, boxes: str | Path | None = None) -> AnyClaim:
    """Read a claim, whatever its kind; what it is, is read from the content of its file.

    Nothing in it is proven again, as `verify` does. The scale of a band is computed again from its
    flights.

    Parameters
    ----------
    path : str or Path
        A file of a certificate, a bound on R_K, a tube or a band.
    boxes : str or Path, optional
        File of `flighttune band --of residual` that confirms the boxes of an aircraft's tube.

    Returns
    -------
    Certificate, RateBound, Tube or Band
        Each has a `sentence` and an `answer()`.

    Raises
    ------
    InputError, RecordingError
        If there is no such file, it is of another kind, or it does not support what it claims.

    Examples
    --------
    >>> tube = ft.tube("paper", "paper", changes={"flight.duration_s": 2.0})
    >>> ft.save_claim(tube, "tube.npz")
    >>> ft.load_claim("tube.npz").status
    'bounded'
    """
    path = Path(path)
    stated = format_of(path, READERS, CLAIM_FILE)
    if boxes is None:
        return READERS[stated](path)
    if stated != "flighttune tube":
        raise InputError("`boxes` must be given for the tube of an aircraft only.")
    return load_tube(path, load_band(boxes))


def save_claim(claim: AnyClaim, path: str | Path) -> None:
    """Write a claim, whatever its kind: under a temporary name until it is whole.

    Parameters
    ----------
    claim : Certificate, RateBound, Tube or Band
    path : str or Path
        File to write or replace; parent folders are made. It is JSON of a certificate or a bound on
        R_K, else an archive (.npz): about 1.3 MB for a band of 1640 flights and two signals.

    Raises
    ------
    InputError
        If it is a tube that is not bounded.
    OutputError
        If the file cannot be written.

    Examples
    --------
    >>> ft.save_claim(ft.certify("paper", "paper").certificate, "proof.json")
    >>> ft.verify("proof.json").valid
    True
    """
    if isinstance(claim, Tube):
        save_tube(claim, path)
    elif isinstance(claim, Band):
        save_band(claim, path)
    else:
        write(claim, path)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verified(Answering):
    """A claim and its verification.

    Attributes
    ----------
    claim : Certificate, RateBound, Tube or Band
    verification : Verification
        Its checks, and the first that fails.
    source : str
        The file that the claim was read from; empty for a value.

    Examples
    --------
    >>> verified = ft.verify(ft.certify("paper", "paper").certificate)
    >>> verified.valid, min(check.margin for check in verified.checks) > 0.0
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
        """Every inequality or inclusion of a proof, with its margin; none of a band."""
        return self.verification.checks

    def answer(self) -> Answer:
        """The checks and the claim; a failure if one of them does not hold."""
        value, valid, kind = self.claim, self.valid, self.claim.kind
        if isinstance(value, Band) and self.source:  # its note has a command that takes the file
            claim = value.answer(self.source)
        else:
            claim = value.answer()
        checks = [asdict(check) for check in self.verification.checks]
        place = f"{self.source}: " if self.source else ""
        title = f"{place}{'valid: every check holds' if valid else 'not valid'}"
        # All inclusions of a tube are exact.
        shown = CHECK_COLUMNS[:2] if isinstance(self.claim, Tube) else CHECK_COLUMNS
        stated = kind if valid else f"claimed, not {kind}"
        return Answer(
            values={**pick(self, "valid reason"), "claim": claim.values},
            tables=[Table(shown, checks, title, name="checks"), *claim.tables],
            notes=[*self.verification.notes, *claim.notes] if valid else [],
            verdict=f"{stated}: {self.claim.sentence}",
            failure="" if valid else f"{place}{self.reason}",
        )


def verify(
    claim: AnyClaim | str | Path,
    *,
    boxes: str | Path | None = None,
    run_code: bool = False,
    pool: WorkerPool | None = None,
) -> Verified:
    """Check a claim from its numbers alone.

    A certificate and a bound on R_K are checked in rational arithmetic without any solver, in
    seconds. A tube is proven again without the search that found it, in a fraction of its time.
    The claim of a band is computed again from its plan and what its file keeps of each flight; five
    of its flights, chosen at random, are flown again, and every suspicious copy.

    Parameters
    ----------
    claim : Certificate, RateBound, Tube, Band, str or Path
        A claim, or its file; what it is, is read from its content.
    boxes : str or Path, optional
        File of `flighttune band --of residual` that confirms the boxes of an aircraft's tube.
    run_code : bool
        Fly flights of a band again that run Python files which it names.
    pool : WorkerPool, optional
        Workers that fly flights of a band again; by default one process of this machine.

    Returns
    -------
    Verified
        `valid`, or the `reason` why not: the inequality, the sample or the flight.

    Raises
    ------
    InputError, RecordingError
        If a file cannot be read or is not a claim.

    Examples
    --------
    >>> ft.verify(ft.certify("paper", "paper").certificate).valid
    True
    """
    source = "" if isinstance(claim, AnyClaim) else str(claim)
    value = claim if isinstance(claim, AnyClaim) else load_claim(claim, boxes)
    if isinstance(value, Band):
        verification = verified_band(value, run_code=run_code, pool=pool)
    else:
        verification = value.verify()
    return Verified(claim=value, verification=verification, source=source)


# Flights that claims can be drawn around.
T = TypeVar("T", FlownScenario, Gap, Source)


def within(flights: T, files: Sequence[str | Path]) -> T:
    """Flights with the claims in files around them; an InputError names the file."""
    for file in files:
        try:
            claim: Any = READERS[format_of(Path(file), READERS, AROUND_FLIGHTS)](Path(file))
            flights = flights.within(claim)
        except InputError as error:
            reason = str(error).removeprefix(f"{file}: ")
            raise InputError(f"{file}: {reason}") from error
    return flights
