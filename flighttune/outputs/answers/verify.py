"""The answer of the verification of a claim."""

from dataclasses import asdict

from flighttune.base.words import pick
from flighttune.claims.counted import Counted, flown_words
from flighttune.claims.monitor import LogMonitor
from flighttune.claims.per_hour import PerHour
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.verify import Verified, stale_notes
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.tables import dispersions_table, gains_table

CHECK_COLUMNS = [Column("name", "check"), *columns("margin exact")]


def answer(verified: Verified) -> Answer:
    """The checks and the claim; a failure if a check fails."""
    value, valid, kind = verified.claim, verified.valid, verified.claim.kind
    file = verified.source or "FILE"  # part of the command in a count's note
    claim = value.answer(file) if isinstance(value, Counted) else value.answer()
    checks = [asdict(check) for check in verified.verification.checks]
    notes = *verified.verification.notes, *claim.notes
    place = f"{verified.source}: " if verified.source else ""
    title = f"{place}{'valid: every check holds' if valid else 'not valid'}"
    about, flown = (value.about, flights(value)) if isinstance(value, PerHour) else ([], [])
    short = [f"{title}.", *about, *claim.summary] if valid and claim.summary else []
    # All inclusions of a tube are exact.
    shown = CHECK_COLUMNS[:2] if isinstance(value, Tube | LogMonitor) else CHECK_COLUMNS
    lacks = kind if verified.verification.checked else "checked"
    return Answer(
        lines=short,
        values={**pick(verified, "valid reason"), "claim": claim.values},
        tables=[Table(shown, checks, "" if short else title, name="checks"), *claim.tables, *flown],
        notes=[*stale_notes(value), *(notes if valid else ())],
        verdict=f"{kind if valid else f'claimed, not {lacks}'}: {verified.claim.sentence}",
        findings=[] if valid else unmet(f"{place}{verified.reason}"),
    )


def flights(hourly: PerHour) -> list[Table]:
    """What is drawn for the flights of a claim per flight hour, and their gains."""
    plan = hourly.flights
    (group,) = plan.groups
    gains = plan.gain_sets[group.gains]
    assert gains is not None  # of the chosen group
    flown = flown_words(plan.scenario, *group)
    return [dispersions_table(hourly.distribution, flown), gains_table("gains", gains)]
