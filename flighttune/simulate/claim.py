"""A claim about flights, whether proven or counted, and runs within it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from flighttune.errors import InputError
from flighttune.simulate.bounds import RunClaim
from flighttune.simulate.run import Run


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


def with_claims(runs: Sequence[Run], claims: Sequence[Claim]) -> tuple[Run, ...]:
    """The runs with the claims that cover them.

    Raises InputError if a claim covers no run, with the reason for the first one.
    """
    for claim in claims:
        reasons = [claim.why_not(run) for run in runs]
        if all(reasons):
            why = f"{runs[0].label}: {reasons[0]}" if runs else "there is no run"
            raise InputError(f"`claim` must cover a run: {why}.")
        runs = [
            run if why else replace(run, claims=(*run.claims, claim.on(run)))
            for run, why in zip(runs, reasons, strict=True)
        ]
    return tuple(runs)
