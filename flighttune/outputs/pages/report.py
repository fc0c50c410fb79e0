"""The page of any source: runs, a campaign, a log or a claim file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flighttune.base.errors import InputError
from flighttune.base.files.load import BAND, CLAIMS, DATASET, MONITOR, load_one, written
from flighttune.campaigns.dataset import Dataset
from flighttune.campaigns.statistics.findings import load_findings
from flighttune.campaigns.statistics.intervals import CONFIDENCE, Method
from flighttune.claims.band import Band
from flighttune.claims.monitor import Watching
from flighttune.claims.verify import within
from flighttune.flight.flown import FlownScenario
from flighttune.gaps.compare import Source, load_source
from flighttune.logs.log import Columns
from flighttune.outputs.pages import campaign, claim
from flighttune.outputs.pages.frame import Report
from flighttune.outputs.pages.page import write_log_page, write_report


def report(
    source: str | Path | FlownScenario,
    path: str | Path | None = None,
    *,
    claims: Sequence[Path | str] = (),
    changes: Mapping[str, Any] | None = None,
    columns: Columns = (),
    interval: Method | None = None,
    confidence: float = CONFIDENCE,
) -> Report:
    """Write one self-contained page about runs, a campaign or a claim.

    It takes seconds, because a page about runs of an aircraft also flies the plants below it.

    Parameters
    ----------
    source : str, Path or FlownScenario
        A run folder, a recording or a Parquet file; ``SCENARIO@GAINS``, which is flown; the folder
        of a campaign, which may be running; the file of a claim; or the log of a real flight (.ulg,
        .bin, .tlog, .csv), ``@START:END`` for a part of it in s. The kind of a file is read from
        its content. Also flights that `fly` returned.
    path : str or Path, optional
        HTML file to write or replace; by default ``report.html``, in the folder of a campaign.
        Parent folders are made.
    claims : sequence of str or Path
        Files of tubes and bands to draw around runs; for a log, monitors, which report alarms, and
        bands of routes, whose widths stand beside the errors of the log's track.
    changes : mapping of str to value, optional
        Values to set by dotted key in a scenario that is flown.
    columns : mapping or sequence
        Where a log has its signals, as for `load_log`.
    interval : {"wilson", "clopper-pearson", "any-time"}
        Confidence interval of the success rates of a campaign, by default wilson, and any-time if
        it flies until it is sure. The any-time interval needs independent draws (``design``
        random). It holds for any number of pages during the flights, so that the page may decide
        when to stop the campaign. It counts the flights before the first gap.
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
        If a claim does not cover a run, if claims or changes are given without runs, or if an
        any-time interval is requested for draws that are not independent.

    Examples
    --------
    >>> ft.report("paper_as_printed@paper", "report.html").summary[0]
    '4 of 4 requirements met.'
    """
    if isinstance(source, FlownScenario):
        if changes:
            raise InputError("`changes` must be absent for flights that `fly` returned.")
        flown = Source(name=source.scenario.title, runs=source.runs)
    else:
        stated = written(source, DATASET, *CLAIMS)
        if stated is not None and (claims or changes or columns):
            raise InputError(
                f"{Path(source)}: `--claim`, `--set` and `--column` must be absent: they are for "
                "runs."
            )
        if isinstance(stated, Dataset):
            findings = load_findings(str(Path(source))).by(interval, confidence)
            return campaign.write_campaign_report(findings, path or Path(source) / "report.html")
        if stated is not None:
            return claim.write_claim_page(stated, str(Path(source)), path or "report.html")
        flown = load_source(source, changes=changes or {}, columns=columns)
    page = Path(path or "report.html")
    if any(run.provenance.log for run in flown.runs):
        corridors, monitors = [], []
        for file in claims:
            of_log = load_one(file, "monitor", MONITOR, BAND)
            if isinstance(of_log, Watching):
                monitors.append(of_log)
            elif isinstance(of_log, Band) and of_log.flights.over == "along":
                corridors.append(of_log)
            else:
                raise InputError(
                    f"{file}: must be a monitor or the band of a route: a log is of no scenario."
                )
        return write_log_page(flown, page, monitors, corridors)
    if columns:
        raise InputError(f"{flown.name}: `--column` must be absent for what is no log.")
    return write_report(within(flown, claims), page)
