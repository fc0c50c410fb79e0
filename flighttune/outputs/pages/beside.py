"""The page that compares a user's guidance with the gains of a scenario."""

from pathlib import Path

from flighttune.flight.fly import library_versions
from flighttune.outputs.answers.answer import facts_table
from flighttune.outputs.pages.frame import Report, Section, write_answer
from flighttune.studies.beside import Beside


def write_beside_page(beside: Beside, path: str | Path, command: str) -> Report:
    """Write the answer as one self-contained page; `command` repeats it."""
    answer, ours = beside.answer(), beside.plan.groups[-1].gains
    # tables of margins, if any, start at the fifth table
    (*notes, unused), (*found, parameters) = answer.notes, answer.tables
    return write_answer(
        path,
        title=f"{beside.plan.scenario.title}: {beside.now.name} beside {ours}",
        summary=answer.summary,
        parts={
            "accuracy": Section(note=notes, tables=found[:4]),
            "margins": Section(tables=found[4:]),
            "flown": Section(note=unused, tables=[parameters]),
        },
        provenance=facts_table("Provenance", library_versions()),
        commands=command,
    )
