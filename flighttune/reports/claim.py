"""The page of a claim: its sentence and numbers, with charts of a tube or a band."""

import hashlib
from pathlib import Path

from flighttune.campaign.claims import AnyClaim
from flighttune.claims.band import Band
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.tables import facts_table
from flighttune.reports.band import write_band_page
from flighttune.reports.tube import write_tube_page
from flighttune.tubes.enclosure import Tube


def write_claim_page(claim: AnyClaim, source: str, path: str | Path) -> Report:
    """Write one self-contained page about the claim in the file `source`."""
    if isinstance(claim, Tube):
        return write_tube_page(claim, source, path)
    if isinstance(claim, Band):
        answer = claim.answer(source)
        return write_band_page(claim, source, path, answer.tables, answer.notes)
    answer = claim.answer()
    facts = {"file": source, "its SHA-256": hashlib.sha256(Path(source).read_bytes()).hexdigest()}
    return write_page(
        Path(path),
        page_template("flighttune.reports", "commands.html.jinja"),
        summary=(f"{claim.sentence[:1].upper()}{claim.sentence[1:]}.",),
        sections=[Section(note=" ".join(answer.notes), tables=answer.tables, legend=False)],
        title="Certificate" if answer.notes else "Bound on R_K",
        provenance=facts_table("Provenance", facts),
        commands=f"flighttune verify {source}",
    )
