"""Write docs/hangar.md and its picture, `adopt` on every model of JSBSim's own set.

Run it by ``python docs/figures/hangar.py [FOLDER]``. Each model is adopted by a command of its own,
as many at once as there are cores; its turn is exported and its circuit flown. FOLDER keeps the
answers: models whose answers are there are not asked again. This takes about ten minutes on two
cores; then the turns are flown again and drawn.
"""

import json
import math
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import flighttune as ft
from flighttune.base.files.shipped import models_of_jsbsim, scenario_files
from flighttune.base.files.table import toml_text
from flighttune.base.units import DEG_PER_RAD, G_PAPER
from flighttune.outputs.answers.answer import Column, Table
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK
from flighttune.vehicles.aircraft.aircraft import load_aircraft

PAGE = Path(__file__).parents[1] / "hangar.md"
PICTURE = PAGE.with_suffix(".svg")

MAX_TIME_S = 600.0  # time that one model may take

# Margin to the limits, factor on the look-ahead and share of the climbs of a circuit, tried in turn
# until it is flown.
CIRCUITS = [
    (margin, look_ahead, climb)
    for climb in (1.0, 0.5, 0.25, 0.1)
    for margin, look_ahead in ((0.2, 1.0), (0.4, 2.0), (0.6, 3.0))
]

STATUSES = ("adopted", "flies", "refused")

# Endings of the notes of an adoption that the page has.
NOTES = "its engines stay off", "not feet as JSBSim has it"

COLUMNS = [*columns("model V_a_mps"), Column("circuit.cross_track_m", "beside circuit", "m", ".2g")]


def adopted(model: str, folder: Path) -> dict[str, Any]:
    """The answer of the command for a model; a crash or an endless flight refuses it."""
    kept = folder.with_name(f"{model}.json")
    if kept.exists():
        return json.loads(kept.read_text(encoding="utf-8"))
    done = None
    answer: dict[str, Any]
    try:
        done = flighttune("adopt", model, "--json", "--out", folder)
        answer = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        answer = {"status": "refused", "reason": f"it took over {MAX_TIME_S:g} s"}
    except json.JSONDecodeError:
        assert done is not None
        reason = f"its process ended with status {done.returncode}: {done.stderr}"
        answer = {"status": "refused", "reason": reason}
    if answer["status"] != "refused":
        answer |= proved(folder, fly=answer["status"] == "adopted")
    print(f"{model}: {answer['status']}", flush=True)
    kept.write_text(json.dumps({"model": model, **answer}), encoding="utf-8")
    return {"model": model, **answer}


def flighttune(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    command = [sys.executable, "-m", "flighttune", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=MAX_TIME_S)


def proved(folder: Path, *, fly: bool) -> dict[str, Any]:
    """Difference of the exported turn (rad, 1) and errors of the circuit, or why there are none."""
    exported = flighttune("export", folder / "turn.toml", "--json", "--out", folder / "export")
    differences = json.loads(exported.stdout or "{}").get("differences", {"": math.nan})
    flown = circuit(folder) if fly else {}
    return {"export": max(differences.values()), "circuit": flown}


def circuit(folder: Path) -> dict[str, Any]:
    """How far beside its route and off its height (m) an aircraft flies the circuit, or why not.

    The circuit is the shipped one at airspeed and limits of the aircraft's turn.
    """
    turn = tomllib.loads((folder / "turn.toml").read_text(encoding="utf-8"))
    if not load_aircraft(str(folder)).engines.count:
        return {"why": "it flies without an engine, about its steady glide"}
    why, file = "", folder / "circuit.toml"
    for margin, look_ahead, climb in CIRCUITS:
        text = toml_text(circuit_of(turn, margin, look_ahead, climb))
        file.write_text(text, encoding="utf-8")
        done = flighttune("fly", file, "--json", "--out", folder / "circuit")
        answer = json.loads(done.stdout or "{}")
        if done.returncode == 0:
            flown = [run["metrics"]["flight"] for run in answer["runs"]]
            largest = ("cross_track_m", "height_err_m")
            return {key: max(run[key] for run in flown) for key in largest}
        why = answer.get("verdict") or done.stderr.strip()
    return {"why": f"misses the circuit: {why}"}


def circuit_of(
    turn: dict[str, Any], margin: float, look_ahead: float, climb: float
) -> dict[str, Any]:
    """Tables of the shipped circuit for an aircraft, from those of its turn."""
    tables = tomllib.loads(scenario_files()["circuit"].read_text(encoding="utf-8"))
    before, V_a, limits = tables["flight"]["V_a_mps"], turn["flight"]["V_a_mps"], turn["limits"]
    wind = tables["route"]["wind_mps"]
    # The radius of a turn at the largest bank, and the way of half a turn's roll-in.
    rooms = [
        (V + wind) ** 2 / (G_PAPER * math.tan(share * of["phi_deg"][1] / DEG_PER_RAD))
        + (V + wind) * of["phi_deg"][1] / of["phi_rate_dps"]
        for V, share, of in ((before, 0.8, tables["limits"]), (V_a, 1.0 - margin, limits))
    ]
    size, faster = rooms[1] / rooms[0], max(1.0, V_a / before)
    factors = {"north_m": size, "east_m": size, "radius_m": size, "up_m": size * climb}
    for point in tables["route"]["waypoint"]:
        point |= {key: factors.get(key, climb) * point[key] for key in point.keys() - {"turns"}}
    tables["route"] |= {"margin": margin, "look_ahead_s": look_ahead * 3.0, "widen": True}
    tables["flight"] |= {"V_a_mps": V_a, "duration_s": 1000.0 * size * before / V_a}
    for expected in tables["expect"]:  # an error of position grows with the way ahead
        most = expected["at_most"]["flight"]
        most |= {key: faster * look_ahead * value for key, value in most.items()}
    tables["plant"][1]["aircraft"] = turn["plant"][0]["aircraft"]
    return tables | {"limits": limits, "tuning": turn["tuning"]}


def turn_chart(model: str, scenario: Path) -> Chart:
    """Course and path angle of the turn with the gains tuned on the identified aircraft."""
    run = ft.fly(scenario).runs[0]
    title = f"{model} at {run.signals['V_a'].iloc[0]:.0f} m/s"
    chart = Chart(title=title, x="", x_range=(0.0, 40.0), height=110.0)
    for signal, hue in zip(("chi", "gamma"), HUES, strict=False):
        for name, colour, dash in ((f"{signal}_ref", INK, DASHED), (signal, hue[0][0], "")):
            degrees = run.signals[name].to_numpy() * DEG_PER_RAD
            chart.line(run.t, degrees, colour, dash=dash, most=60, width=1.4)
    return chart


def listed(said: Iterable[tuple[str, str]]) -> str:
    """A line for each remark, with the models that it is about."""
    models: dict[str, list[str]] = {}
    for model, remark in said:
        models.setdefault(remark, []).append(f"`{model}`")
    return "\n".join(f"- {', '.join(names)}: {remark}" for remark, names in models.items())


def remarks_of(answer: dict[str, Any]) -> list[str]:
    """Why a model is not adopted, or does not fly the circuit."""
    why = answer.get("circuit", {}).get("why", "")
    before, ended, reason = why.partition("tuned_fed_back: ")
    circuit = f"misses the circuit: {reason.partition(' To try next')[0]}" if ended else before
    notes = [note for note in answer.get("notes", ()) if note.endswith(NOTES)]
    return [*notes, *filter(None, (answer["reason"], circuit))]


def hangar_text(answers: Sequence[dict[str, Any]]) -> str:
    """The page: a row for each model that is adopted, remarks, and why others are refused."""
    of = {status: [one for one in answers if one["status"] == status] for status in STATUSES}
    flown, adopted = of["adopted"] + of["flies"], of["adopted"]
    chi, gamma = (
        sum(one["flown"]["tuned"]["ITAE"][c] < one["flown"]["paper"]["ITAE"][c] for one in adopted)
        for c in ("chi", "gamma")
    )
    fits = [min(one["fit_percent"][key] for one in adopted) for key in ("phi", "n_z")]
    height = max(one["circuit"].get("height_err_m", 0.0) for one in adopted)
    most = max(one["export"] for one in adopted)
    page = PAGE.read_text(encoding="utf-8")
    # kinds.py writes this part.
    kinds = page[page.index("## With every command") : page.index("## Remarks")]
    return f"""# The hangar: every model of JSBSim's own set

JSBSim comes with {len(answers)} models. `flighttune adopt MODEL` gives each a
[status](aircraft.md): {", ".join(f"{len(of[status])} {status}" for status in STATUSES)}.
The page is made by `python docs/figures/hangar.py` with flighttune {ft.__version__} and JSBSim {
        version("jsbsim")
    };
the default law flies all turns and circuits.

## Adopted

Each aircraft flies a turn of 20° with a climb of 3°; a glider descends 3° steeper than its
glide. Aircraft with an engine also fly the [circuit](routes.md#what-it-reaches), scaled to their
airspeed. The table has the largest distance beside the route; the largest in height is {
        height:.2g} m.

{Table(columns=COLUMNS, records=adopted).markdown()}

The identified models fit roll by {fits[0]:.1f} % or better and load factor by {fits[1]:.1f} % or
better. Exported turns differ from flown ones by at most {most:.0e}.
Gains tuned on them have a smaller ITAE than the paper's K*, scaled with airspeed, on
{chi} of {len(adopted)} aircraft for course and {gamma} for path angle.

{kinds}## Remarks

{listed((one["model"], remark) for one in flown for remark in remarks_of(one))}

JSBSim takes the thrust of `C130`'s turbines for the power of their propellers, 14 hp each.

## Refused

{listed((one["model"], ", ".join(remarks_of(one))) for one in of["refused"])}

## The turns

![Course and path angle (deg) of each turn over 40 s, with their references](hangar.svg)
"""


def write_page(folder: Path, answers: Sequence[dict[str, Any]]) -> None:
    """Write the page and its picture from the answers and the folders of the aircraft."""
    flown = [answer["model"] for answer in answers if answer["status"] != "refused"]
    names = [("course", HUES[0][0][0], ""), ("path angle", HUES[1][0][0], "")]
    Sheet(
        charts=[turn_chart(model, folder / model / "turn.toml") for model in flown],
        columns=2,
        legend=[*names, ("reference", INK, DASHED)],
    ).save(PICTURE)
    PAGE.write_text(hangar_text(answers), encoding="utf-8")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        models = models_of_jsbsim()
        answers = [*pool.map(adopted, models, [folder / model for model in models])]
    write_page(folder, answers)
