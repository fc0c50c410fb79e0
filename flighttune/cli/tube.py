"""The command that encloses all flights of a scenario, and answers about tubes."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Option

from flighttune.cli import options
from flighttune.cli.show import progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.units import DEG


def tube(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first that is not an aircraft")] = None,
    start_deg: options.StartOption = 0.0,
    disturbance: Annotated[
        str | None,
        Option(
            metavar="RAD_S|largest",
            help="Bound on the disturbance of each rate, rad/s [default: the scenario's, or the "
            "residual of the logs of a model]; largest searches, to two digits, for the largest "
            "for which the set is bounded.",
        ),
    ] = None,
    boxes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of `flighttune band --of residual`: bound its aircraft, with rates in it.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Option("--out", help="Proof file (.npz) to write [default: runs/NAME-tube.npz]."),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time, or if a flight leaves it.
    """
    from flighttune.campaign.band import load_band
    from flighttune.campaign.claims import save_claim
    from flighttune.tubes.tube import largest_disturbance
    from flighttune.tubes.tube import tube as enclose

    options.check_ending(out, ".npz")
    largest = disturbance == "largest"
    if largest and (boxes, out) != (None, None):
        raise InputError("`disturbance` must be a number with --boxes or --out, got largest.")
    flights = {"plant": plant, "start": start_deg * DEG, "changes": options.changes(settings)}
    with progress_bar() as progress:
        follow = None if progress is None else partial(progress, "tube")
        if largest:
            answer = largest_disturbance(scenario, gains, **flights, progress=follow).answer()
        else:
            enclosure = enclose(
                scenario,
                gains,
                None if boxes is None else load_band(boxes),
                disturbance=options.number(disturbance, "--disturbance"),
                progress=follow,
                **flights,
            )
            proof = None
            if enclosure.status == "bounded":
                proof = out or Path("runs") / f"{Path(scenario).stem}-tube.npz"
                save_claim(enclosure, proof)
            answer = replace(enclosure.answer(gains or ""), files={"proof": proof})
    return answer
