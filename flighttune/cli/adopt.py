"""The command that makes an aircraft from a JSBSim model."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flighttune.cli.progress import raise_on_interrupt
from flighttune.cli.show import INTERRUPTED, NO, emit, fail, quiet, table, tell
from flighttune.errors import InputError
from flighttune.present.tables import Table

if TYPE_CHECKING:
    from flighttune.adopt.adopt import Adoption


def adopt(
    model: Annotated[
        str | None,
        Argument(
            metavar="[MODEL|FILE.xml]",
            help="A model that comes with JSBSim, or the main file of another.",
            show_default=False,
        ),
    ] = None,
    V_a: Annotated[
        float | None, Option("--V-a", help="Airspeed in m/s [default: chosen by the model].")
    ] = None,
    h: Annotated[float, Option("--h", help="Height above sea level in m.")] = 1000.0,
    all_models: Annotated[
        bool, Option("--all", help="Adopt all models that come with JSBSim; write one table.")
    ] = False,
    out: Annotated[
        Path | None,
        Option(
            "--out", help="Folder to write to [default: aircraft/MODEL; runs/hangar with --all]."
        ),
    ] = None,
) -> None:
    """Make an aircraft from a JSBSim model: find its surfaces and engines, tune it and fly it.

    Surfaces, engines and airspeed are found by experiment; the inner loop is designed, flown and
    identified, the outer loop is tuned on the identified model and flown in a turn, compared with
    the paper's gains scaled with airspeed.
    """
    if (model is None) == (not all_models):
        raise InputError("adopt takes a model, or --all.")
    try:
        with raise_on_interrupt():
            if model is None:
                _adopt_all(out or Path("runs") / "hangar", h)
            else:
                _adopt_one(model, V_a, h, out)
    except KeyboardInterrupt:
        fail("interrupted; what is written is whole", INTERRUPTED)


def _adopt_one(model: str, V_a: float | None, h: float, out: Path | None) -> None:
    from flighttune.adopt.adopt import adopt as adopted
    from flighttune.adopt.page import write_adoption

    folder = out or Path("aircraft") / Path(model).stem
    found = adopted(model, folder, V_a=V_a, h=h, say=_progress)
    page = write_adoption(found) if found.folder else None
    emit(answer_of(found) | {"page": page}, _text(found, page))
    if found.status != "adopted":
        fail(f"{model}: {found.status}: {found.reason}", NO)


def _adopt_all(out: Path, h: float) -> None:
    from flighttune.adopt.hangar import TABLE, adopt_all, counts, hangar_text
    from flighttune.plants.jsbsim.model_files import models_of_jsbsim
    from flighttune.whole_file import made_folder, write_text

    def seen(one: dict[str, Any]) -> None:
        reason = f": {one['reason']}" if one["reason"] else ""
        _progress(f"{one['model']}: {one['status']}{reason}")

    answers = adopt_all(models_of_jsbsim(), partial(_adopted, made_folder(out), h), seen)
    write_text(out / TABLE, hangar_text(answers))
    emit(
        {"models": answers, "table": out / TABLE},
        [counts(answers), f"table: {out / TABLE}"],
    )


def _adopted(out: Path, h: float, model: str) -> dict[str, Any]:
    """The answer of one model of all, in its own process."""
    from flighttune.adopt.adopt import adopt as adopted
    from flighttune.adopt.page import write_adoption

    adoption = adopted(model, out / model, h=h)
    page = write_adoption(adoption) if adoption.folder else None
    return answer_of(adoption) | {"page": page}


def _progress(line: str) -> None:
    if not quiet():
        tell(line)


def answer_of(found: "Adoption") -> dict[str, Any]:
    """An adoption as plain values; angles in deg."""
    return {
        "status": found.status,
        "reason": found.reason,
        "folder": found.folder,
        "V_a_mps": found.V_a,
        "engines": found.engines,
        "fit_percent": dict(found.fit_percent),
        "flown": {
            name: {
                "status": flight["status"],
                "ITAE": {c: flight[c]["ITAE"] for c in ("chi", "gamma") if c in flight},
                "ST_deg": {
                    c: math.degrees(flight[c]["ST"]) for c in ("chi", "gamma") if c in flight
                },
            }
            for name, flight in found.flown.items()
        },
        "notes": found.notes,
        "seconds": found.seconds,
    }


def _text(found: "Adoption", page: Path | None) -> Iterator[Table | str]:
    if found.flown:
        rows = [
            (
                name,
                flight["status"],
                *(
                    f"{flight[c][measure] * unit:.3g}" if c in flight else "-"
                    for measure, unit in (("ITAE", 1.0), ("ST", math.degrees(1.0)))
                    for c in ("chi", "gamma")
                ),
            )
            for name, flight in found.flown.items()
        ]
        head = ("gains", "flight", "ITAE χ", "ITAE γ", "ST χ deg", "ST γ deg")
        yield table(f"{found.name} at {found.V_a:.0f} m/s: turn of 20 deg, climb of 3", head, rows)
        fits = ", ".join(f"{name} {fit:.1f} %" for name, fit in found.fit_percent.items())
        yield f"fit of the identified lags: {fits}"
    yield from found.notes
    yield f"{found.status} in {found.seconds:.0f} s"
    if found.folder:
        yield f"aircraft: {found.folder}   page: {page}"
