"""The command that flies one run of a campaign again, for a recording."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import NO, JsonOption, fail, print_json, progress_bar, say, tell

if TYPE_CHECKING:
    from flighttune.campaign.dataset.dataset import Dataset
    from flighttune.campaign.flying.refly import RowDifference

FALLEN = ("crashed", "timed_out")
"""Of such a run there is nothing to compare, and it may do here what it did there."""


def fly(
    folder: Annotated[
        str, typer.Argument(metavar="DIR", help="Folder or URL of the dataset of a campaign.")
    ],
    run: Annotated[int, typer.Option(help="Which run, as in the column `run`.", min=0)],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the recording; by default runs/NAME-run-N."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Fly a run of the campaign in DIR again and record it; is it what its row says?

    Exit status 1 if it is not, to the bit; every difference is shown.
    """
    from flighttune.campaign.dataset.dataset import open_dataset
    from flighttune.campaign.flying.refly import fly_again, row_differences
    from flighttune.recording.record import record

    dataset = open_dataset(folder)
    row = _row(dataset, run)
    if row["status"] in FALLEN:
        tell(f"run {run} {row['status'].replace('_', ' ')} in the campaign: {row['reason']}")
    name = f"{Path(folder).name}-run-{run}"
    with progress_bar() as progress:
        again = fly_again(dataset.plan, run, progress=progress)
    files = record(again.flown, out if out is not None else Path("runs") / name, name=name)
    different = row_differences(dataset.plan, run, again.run, row)
    versions = _versions(dataset.versions)
    if as_json:
        print_json(
            {
                "run": run,
                "plant": row["plant"],
                "gains": row["gains"],
                "status": again.run.status,
                "reason": again.run.reason,
                "equal": not different,
                "differences": [
                    {"column": d.column, "in_row": d.in_row, "flown": d.flown} for d in different
                ],
                "versions": {
                    key: {"campaign": then, "now": now} for key, (then, now) in versions.items()
                },
                "row": row,
                "recording": str(files.recording),
                "signals": {label: str(path) for label, path in files.signals.items()},
            }
        )
    else:
        _print(dataset, row, different, versions)
        say(f"recording: {files.recording}   (open it with: flighttune view {files.recording})")
    if different:
        fail(f"{folder}: run {run}: {_sentence(different[0])}", NO)


def _row(dataset: "Dataset", run: int) -> dict[str, Any]:
    from flighttune.errors import RecordingError

    for span in dataset.spans:
        if span.first <= run < span.end:
            return dataset.read_part(span).slice(run - span.first, 1).to_pylist()[0]
    raise RecordingError(
        f"{dataset.url}: `run` must be one that was flown, got {run} of {dataset.plan.runs}."
    )


def _versions(then: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Libraries whose version is another one than that of the campaign."""
    from flighttune.one_flight import library_versions

    now = library_versions()
    return {
        name: (version, now.get(name, "none"))
        for name, version in then.items()
        if now.get(name) != version
    }


def _print(
    dataset: "Dataset",
    row: dict[str, Any],
    different: tuple["RowDifference", ...],
    versions: Mapping[str, tuple[str, str]],
) -> None:
    say(f"run {row['run']}: {row['plant']} / {row['gains']}, draw {row['draw']}")
    for key in dataset.plan.keys:
        say(f"  {key} = {row[key]!r}")
    ended = f"{row['status']}: {row['reason']}" if row["reason"] else row["status"]
    say(f"row: {ended}; {row['missed'] or 'a success'}")
    for difference in different:
        say(_sentence(difference))
    if not different:
        say("flown again: status and every measure equal to the bit")
    for name, (then, now) in versions.items():
        say(f"{name}: {then} in the campaign, {now} now")


def _sentence(difference: "RowDifference") -> str:
    return (
        f"`{difference.column}` differs: {difference.in_row!r} in the row, "
        f"{difference.flown!r} flown again"
    )
