"""The page of anything: of runs, of a campaign, of a gap, or of the claim in a file."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flighttune.campaign.claims import within
from flighttune.campaign.dataset import Dataset, dataset_hash
from flighttune.campaign.statistics.findings import load_findings
from flighttune.campaign.statistics.intervals import CONFIDENCE, Method
from flighttune.claims.monitor import LogMonitor, Monitor
from flighttune.errors import InputError
from flighttune.files.load import BAND, CLAIMS, DATASET, MONITOR, load_one, written
from flighttune.files.table import toml_text
from flighttune.gaps.gap import Gap
from flighttune.logs.log import Columns
from flighttune.present.answer import Answer, Table, pick
from flighttune.present.frame import Report, Section, write_answer
from flighttune.records.compare import Source, load_source
from flighttune.reports import campaign_tables as tables
from flighttune.reports.campaign import notes, summary, write_campaign_report
from flighttune.reports.charts import gap_charts
from flighttune.reports.claim import write_claim_page
from flighttune.reports.page import flown_in_words, write_log_page, write_report
from flighttune.reports.tables import provenance_table
from flighttune.simulate.run import claim_notes, claimed, run_styles

CLAIM_NOTE = (
    "The error of the aircraft is drawn in the tubes and bands that cover its flight: "
    "flighttune gap SCENARIO takes --claim FILE."
)


def write_gap_page(gap: Gap, tables: Sequence[Table], path: str | Path) -> Report:
    """Write one self-contained page about a gap; InputError if the aircraft did not fly."""
    origin = gap.aircraft.provenance
    return write_answer(
        path,
        title=f"From the law to the aircraft: {gap.scenario.title}; gains {gap.name}",
        about=(flown_in_words(gap.scenario, gap.runs),),
        summary=gap.causes,
        parts={
            "responses": Section(
                note=" ".join([CLAIM_NOTE, *claim_notes([gap.aircraft])]),
                charts=gap_charts(gap),
                legend=False,
            ),
            "numbers": Section(title="Numbers", tables=tables, legend=False),
        },
        styles=run_styles(gap.runs),
        provenance=provenance_table(gap.scenario.title, gap.scenario, gap.runs),
        commands=f"flighttune gap scenario.toml --gains {origin.gains_name}",
        texts={"scenario.toml": toml_text(origin.scenario)},
    )


# Tables of runs that a terminal shows too; ``--json`` has the records of all.
PRINTED = ("convergence", "certificates", "aircraft")


def report(
    source: str | Path | Source,
    path: str | Path | None = None,
    *,
    claims: Sequence[str | Path] = (),
    changes: Mapping[str, Any] | None = None,
    columns: Columns = (),
    interval: Method = "wilson",
    confidence: float = CONFIDENCE,
) -> Report:
    """Write one page about runs, a campaign or a claim, which needs no network.

    It takes seconds: a page about runs of an aircraft flies the plants below it too.

    Parameters
    ----------
    source : str, Path or Source
        A run folder, a recording or a Parquet file; ``SCENARIO@GAINS``, which is flown; the folder
        of a campaign, which may be running; the file of a claim; or the log of a real flight (.ulg,
        .bin, .tlog, .csv), ``@START:END`` for a part of it in s. What a file is, is read from its
        content.
    path : str or Path, optional
        HTML file to write or replace; by default ``report.html``, in the folder of a campaign.
        Parent folders are made.
    claims : sequence of str or Path
        Files of tubes and bands to draw around runs; of a log monitors, which say when it alarms.
    changes : mapping of str to value, optional
        Values to set in a scenario that is flown, by dotted key.
    columns : mapping or sequence
        Where a log has its signals, as for `load_log`.
    interval : {"wilson", "clopper-pearson", "any-time"}
        Confidence interval of the success rates of a campaign; any-time is for independent draws
        (``design`` random) and holds however often the page is made while they are flown, so that
        the campaign may be stopped by what it says. It counts the flights before the first gap.
    confidence : float
        Confidence of the intervals of a campaign, 0 to 1, by default 0.95.

    Returns
    -------
    Report

    Raises
    ------
    RecordingError
        If no run flew, the runs are of several scenarios, or a file is damaged.
    OutputError
        If the page cannot be written.
    InputError
        If a claim does not cover a run, claims or changes are given for anything but runs, or an
        interval at any time for draws that are not independent.

    Examples
    --------
    >>> ft.report("paper_as_printed@paper", "report.html").summary[0]
    'Claim met: 4 of 4 requirements.'
    """
    changes = changes or {}
    if not isinstance(source, Source):
        place, stated = Path(source), written(source, DATASET, *CLAIMS)
        if stated is not None:
            if claims or changes or columns:
                raise InputError(
                    f"{place}: `--claim`, `--set` and `--column` are for runs, and must be absent."
                )
            if isinstance(stated, Dataset):
                page = Path(path or place / "report.html")
                return _of_campaign(place, page, interval, confidence)
            written_page = write_claim_page(stated, str(place), path or "report.html")
            return replace(written_page, shown=stated.answer())
        source = load_source(source, changes=changes, columns=columns)
    if any(run.provenance.log for run in source.runs):
        monitors = [load_one(file, "monitor", MONITOR, BAND) for file in claims]
        for file, monitor in zip(claims, monitors, strict=True):
            if not isinstance(monitor, Monitor | LogMonitor):
                raise InputError(f"{file}: must be a monitor: a log is of no scenario.")
        return write_log_page(source, Path(path or "report.html"), monitors)
    if columns:
        raise InputError(f"{source.name}: `--column` must be absent for what is no log.")
    return _of_runs(within(source, claims), Path(path or "report.html"))


def _of_campaign(folder: Path, path: Path, interval: Method, confidence: float) -> Report:
    statistics = load_findings(str(folder)).by(interval, confidence)
    groups = statistics.values["groups"]
    shown = Answer(
        values={**statistics.values, "sha256": dataset_hash(folder)},
        tables=[
            tables.success_table(statistics, groups),
            tables.reasons_table(groups),
            *tables.paired_tables(statistics),
        ],
        notes=[*summary(statistics), *notes(statistics)],
    )
    return replace(write_campaign_report(statistics, path), shown=shown)


def _of_runs(source: Source, path: Path) -> Report:
    page, around = write_report(source, path), claimed(source.runs)
    named = [table for table in page.tables if table.name]
    shown = Answer(
        values={
            "bytes": path.stat().st_size,
            **pick(page, "summary sections"),
            "tables": {table.name: table.records for table in named},
            **around.values,
        },
        tables=[replace(table, name="") for table in named if table.name in PRINTED],
        notes=[*page.summary, *around.notes],
        failure=around.failure,
    )
    return replace(page, shown=shown)
