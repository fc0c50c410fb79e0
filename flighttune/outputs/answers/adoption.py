"""The answer of an adoption."""

import math

from flighttune.base.words import listed, pick
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.trim import who_flies
from flighttune.studies.adoption.adopt import TURN, Adoption


def answer(adoption: Adoption) -> Answer:
    """The aircraft's flight of the turn; a failure unless it is adopted."""
    folder = adoption.folder
    (drag, share), glide = adoption.largest_drag, ""
    if math.isfinite(adoption.glide_ratio):
        glide = f", with a glide ratio of {adoption.glide_ratio:.1f} at {adoption.V_a:.0f} m/s"
        glide += f" ({100.0 * share:.0f} % of the drag is {drag})" if drag else ""
    values = pick(adoption, "status reason engines seconds")
    values |= {"V_a_mps": adoption.V_a, "glide_ratio": adoption.glide_ratio}
    values |= {"largest_drag": {drag: share} if drag else {}}
    values |= {"switched_off": [part._asdict() for part in adoption.switched_off]}
    lacking = listed([part.words for part in adoption.switched_off])
    lacking = f", without {lacking}" if lacking else ""
    return Answer(
        values=values | pick(adoption, "fit_percent flown not_compiled"),
        tables=[turn_table(adoption)],
        notes=[*adoption.notes, *[who_flies(adoption.not_compiled)] * bool(folder)],
        verdict=f"{adoption.status} in {adoption.seconds:.0f} s{glide}{lacking}",
        files={
            "folder": folder,
            "draft": adoption.draft,
            "scenario": folder / TURN if folder else None,
        },
        findings=(
            [] if adoption.status == "adopted" else unmet(f"{adoption.status}: {adoption.reason}")
        ),
    )


def turn_table(adoption: Adoption) -> Table:
    """Results of the turn by gain set."""
    title = f"{adoption.name} at {adoption.V_a:.0f} m/s: {adoption.turn_name}"
    return Table(
        columns("gains status ITAE.chi ITAE.gamma ST_deg.chi ST_deg.gamma", of="adopted"),
        list(adoption.flown.values()),
        title,
    )
