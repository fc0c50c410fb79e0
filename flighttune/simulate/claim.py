"""A claim about flights, whether proven or counted, and runs within it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

from flighttune.errors import InputError
from flighttune.present.answer import Answer, pick
from flighttune.simulate.bounds import RunClaim
from flighttune.simulate.run import Run, claim_notes


@runtime_checkable
class Claim(Protocol):
    """A claim about flights, which a tube proves or a band counts."""

    @property
    def sentence(self) -> str:
        """The claim in words, made from its content."""
        ...

    def why_not(self, run: Run) -> str:
        """Why the claim says nothing of a run; empty if it covers it."""
        ...

    def on(self, run: Run) -> RunClaim:
        """The claim at the samples of a run that it covers."""
        ...


def with_claims(runs: Sequence[Run], claims: Sequence[object]) -> tuple[Run, ...]:
    """The runs with the claims that cover them.

    Raises InputError if a claim does not bound flights, or covers no run, with the reason for the
    first one.
    """
    for claim in claims:
        if not isinstance(claim, Claim):
            what = type(claim).__name__
            raise InputError(f"`claim` must bound flights, as a tube or a band, got a {what}.")
        reasons = [claim.why_not(run) for run in runs]
        if all(reasons):
            why = f"{runs[0].label}: {reasons[0]}" if runs else "there is no run"
            raise InputError(f"`claim` must cover a run: {why}.")
        runs = [
            run if why else replace(run, claims=(*run.claims, claim.on(run)))
            for run, why in zip(runs, reasons, strict=True)
        ]
    return tuple(runs)


def claimed(runs: Sequence[Run]) -> Answer:
    """What is claimed of runs, as part of an answer; a run outside a proven tube is a failure."""
    claims = [
        {"run": run.label, **pick(claim, "kind title sentence"), "inside": inside}
        for run in runs
        for claim in run.claims
        for inside in [claim.contains(run.signals)]
    ]
    left = [claim for claim in claims if claim["kind"] == "proven" and not claim["inside"]]
    check = "Claims are drawn as their files state them: flighttune verify FILE checks one."
    return Answer(
        values={"claims": claims},
        notes=[*claim_notes(runs), *([check] if claims else [])],
        failure=f"{left[0]['run']}: the flight leaves its {left[0]['title']}." if left else "",
    )
