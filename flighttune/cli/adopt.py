"""The command that makes an aircraft from a JSBSim model."""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flighttune.cli.progress import raise_on_interrupt
from flighttune.cli.show import INTERRUPTED, NO, emit, fail, pick, quiet, tell
from flighttune.errors import InputError
from flighttune.present.answer import Answer

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
    from flighttune.adopt.adopt import adopt as adopt_model
    from flighttune.adopt.page import write_adoption

    folder = out or Path("aircraft") / Path(model).stem
    adoption = adopt_model(model, folder, V_a=V_a, h=h, say=_progress)
    page = write_adoption(adoption) if adoption.folder else None
    emit(_answer(adoption, page))
    if adoption.status != "adopted":
        fail(f"{model}: {adoption.status}: {adoption.reason}", NO)


def _answer(adoption: "Adoption", page: Path | None) -> Answer:
    from flighttune.adopt.page import flights_table

    return Answer(
        values={
            **pick(adoption, "status reason engines seconds"),
            "V_a_mps": adoption.V_a,
            "fit_percent": adoption.fit_percent,
            "flown": adoption.flown,
        },
        tables=[flights_table(adoption)],
        notes=adoption.notes,
        verdict=f"{adoption.status} in {adoption.seconds:.0f} s",
        files={"folder": adoption.folder, "page": page},
    )


def _adopt_all(out: Path, h: float) -> None:
    from flighttune.adopt.hangar import TABLE, adopt_all, counts, hangar_text
    from flighttune.plants.jsbsim.model_files import models_of_jsbsim
    from flighttune.whole_file import made_folder, write_text

    def show(adopted: dict[str, Any]) -> None:
        reason = f": {adopted['reason']}" if adopted["reason"] else ""
        _progress(f"{adopted['model']}: {adopted['status']}{reason}")

    answers = adopt_all(models_of_jsbsim(), partial(_adopted, made_folder(out), h), show)
    write_text(out / TABLE, hangar_text(answers))
    emit(Answer(values={"models": answers}, verdict=counts(answers), files={"table": out / TABLE}))


def _adopted(out: Path, h: float, model: str) -> dict[str, Any]:
    """The answer for one of all models, which is adopted in a process of its own."""
    from flighttune.adopt.adopt import adopt as adopted
    from flighttune.adopt.page import write_adoption

    adoption = adopted(model, out / model, h=h)
    page = write_adoption(adoption) if adoption.folder else None
    return json.loads(_answer(adoption, page).json())


def _progress(line: str) -> None:
    if not quiet():
        tell(line)
