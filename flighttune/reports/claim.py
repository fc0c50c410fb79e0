"""The page of a claim: its sentence and numbers, with charts of a tube or a band."""

import hashlib
from pathlib import Path

from flighttune.campaign.claims import AnyClaim, stale_notes
from flighttune.certificates.certificate import Certificate
from flighttune.claims.band import Band
from flighttune.files.table import toml_text
from flighttune.present.chart import Chart
from flighttune.present.frame import Report, Section, write_answer
from flighttune.present.palette import HUES, NEUTRAL
from flighttune.present.tables import facts_table, quoted
from flighttune.reports.band import band_charts
from flighttune.reports.panels import ERRORS
from flighttune.tubes.enclosure import Tube
from flighttune.units import DEG_PER_RAD

(STRONG, _), _ = HUES[0]

BAND_NOTE = "A line joins the lowest and the highest value of a counted flight in each window."
GIVEN = "The middle predicted from the wind of each flight is subtracted."


def write_claim_page(
    claim: AnyClaim, source: str, path: str | Path, room: Band | None = None
) -> Report:
    """Write one self-contained page about the claim in the file `source`.

    `room`: of the flights of the same route that turn back, whose volumes are drawn on its map.
    """
    answer = claim.answer(source) if isinstance(claim, Band) else claim.answer()
    facts = {"file": source, "its SHA-256": hashlib.sha256(Path(source).read_bytes()).hexdigest()}
    sentences, notes, charts = [claim.sentence], [*stale_notes(claim), *answer.notes], []
    tables = [*answer.tables]
    title, commands, scenario = "Bound on R_K", f"flighttune verify {source}", ""
    campaign = ""
    if isinstance(claim, Certificate):
        title = "Certificate"
    elif isinstance(claim, Tube):
        problem, settings, charts = claim.problem, claim.settings, tube_charts(claim)
        title, scenario = f"Tube: {problem.scenario.title}", toml_text(problem.scenario.as_dict())
        facts["law"] = problem.law.name
        facts["settings"] = f"{settings.symbols} symbols, {settings.most} pieces at most"
    elif isinstance(claim, Band):
        about, charts = claim.about, band_charts(claim, room)
        title = f"Counted band of flights titled {quoted(about.plan['campaign']['title'])}"
        facts["flights"] = f"{len(claim.scores)} counted, {about.learned} learned from"
        facts["flights lost"] = claim.lost
        facts["seed"] = f"{about.plan['campaign']['seed']}"
        if claim.flights.over == "along":
            tables += claim.flights.route.answer().tables
        sentences += [claim.inside(x).sentence for x in about.fences]
        notes = [note for note in notes if note != claim.sentence]
        scenario = toml_text(claim.flights.scenario.as_dict())
        campaign = toml_text(about.plan["campaign"])
        if room is not None:
            turning = room.answer()
            sentences.append(room.sentence)
            notes += [note for note in turning.notes if "refly" not in note]
            tables.append(turning.tables[0])
        notes = [*notes, BAND_NOTE, *([GIVEN] if about.predicted_from else [])]
        commands += f"\nflighttune refly {source} --count 20"
    drawn = [table for table in tables if table.name == "dispersions"]
    others = [table for table in tables if table.name != "dispersions"]
    return write_answer(
        path,
        title=title,
        summary=sentences,
        parts={
            "responses": Section(charts=charts, legend=False),
            "flown": Section(tables=drawn, legend=False),
            "claim": Section(note=" ".join(notes), tables=others, legend=False),
        },
        provenance=facts_table("Provenance", facts),
        commands=commands,
        texts={"scenario.toml": scenario, "campaign.toml": campaign},
    )


def tube_charts(tube: Tube) -> list[Chart]:
    """Both errors: the bounds of every flight."""
    charts, bounds = [], tube.bounds
    for i, (_, title, unit) in enumerate(ERRORS):
        chart = Chart(title=title, y=unit, x_range=(0.0, float(bounds.t[-1])), linked=True)
        chart.level(0.0, NEUTRAL, dash="")
        low, high = bounds.low[:, i] * DEG_PER_RAD, bounds.high[:, i] * DEG_PER_RAD
        chart.band(bounds.t, low, high, STRONG, name="tube")
        for edge in (low, high):
            chart.line(bounds.t, edge, STRONG, width=1.2)
        charts.append(chart)
    return charts
