"""Errors of laws over those of the paper's law with ``tuned_identified``, on the same flights.

Nominal flights: a step of course of 60 deg, a ramp of 90 deg, a planned mission in calm air and in
wind with light turbulence. Then draws of that mission on aircraft that differ, in the winds of
their campaign. Figures are ITAE over that of the paper's law, geometric means of course and path
angle; the half-width is the second largest error of the draws, deg. Peers, PID with feed-forward
and LQI, are own laws (`peers.py`) with textbook gains.

Run it with ``python benchmarks/bench_laws.py``; ``--json`` prints one object, ``--aircraft``
chooses one, ``--draws`` their number and ``--seed`` which;
``--two`` flies the paper's law and the new one alone. Exits with 1 where a target is missed.
"""

import json
import tempfile
from pathlib import Path

import numpy as np
import running

import flighttune as ft
from flighttune.base.files import code
from flighttune.campaigns.dataset import open_dataset
from flighttune.campaigns.planning.plan import plan_campaign
from flighttune.campaigns.planning.source import load_campaign

BASE = "paper"
LAWS = {
    BASE: ("paper", "tuned_identified"),
    "exact": ("exact", "tuned_identified"),
    "exact, fed back": ("exact", "tuned_fed_back"),
    "pid": ("Pid", None),
    "lqi": ("Lqi", None),
}
NEW = "exact, fed back"
SEED = 4101

# Airspeed, rate of turn and climb (deg/s), roll-in (s), limits, and the campaign whose draws fly.
AIRCRAFT = {
    "aerosonde": (25.0, 10.0, 2.5, 1.2, (30.0, -2.1, 2.1, 1.0), "mission_in_wind"),
    "c172p": (50.0, 5.0, 0.75, 2.0, (20.0, -0.5, 2.5, 0.7), "circuit_in_wind_c172p"),
    "a4": (200.0, 2.0, 2.5, 1.0, (60.0, -1.0, 5.0, 2.0), "circuit_in_wind_a4"),
    "x8": (18.0, 10.0, 2.5, 1.2, (30.0, -0.5, 2.1, 1.0), "circuit_in_wind_x8"),
}

# Largest mean of the nominal flights, largest step, and of the draws ITAE and half-widths; an
# aircraft without them is printed.
TARGETS = {
    "aerosonde": {"nominal": 0.36, "step": 0.43, "draws": 0.68, "chi": 1.27, "gamma": 1.68},
    "c172p": {"nominal": 0.66, "step": 0.51, "draws": 0.79},
}


def tables(aircraft: str, flight: str, law: str) -> dict:
    """A flight by one law, as the tables of a scenario."""
    V, turn, climb, roll_in, (roll, low, high, lift), _ = AIRCRAFT[aircraft]
    kind, gains = LAWS[law]
    own = {"name": law, "kind": "python", "module": str(Path(__file__).with_name("peers.py"))}
    own |= {"class": kind, "parameters": {"aircraft": aircraft, "V": V}}
    ramp = {"shape": "ramp", "start_s": 2.0, "duration_s": 90.0 / turn, "rate_dps": turn}
    reference = {
        "step": {"chi_deg": [{"shape": "step", "start_s": 2.0, "change_deg": 60.0}]},
        "ramp": {"chi_deg": [ramp]},
    }.get(flight)
    if reference is None:
        out = {"shape": "ramp", "start_s": 12.0, "duration_s": 60.0 / turn, "rate_dps": -turn}
        up = {"shape": "ramp", "start_s": 34.0, "duration_s": 4.0, "rate_dps": climb}
        reference = {
            "chi_deg": [out | {"roll_in_s": roll_in}],
            "gamma_deg": [up | {"roll_in_s": 1.0}],
        }
    windy = {"wind": {"speed_mps": 6.0, "from_deg": 200.0}, "turbulence": {"intensity": "light"}}
    return {
        "title": f"{aircraft}: {flight}",
        "seed": 5,
        "law": [own if gains is None else kind],
        "gains": [gains or "tuned_identified"],
        "flight": {
            "V_a_mps": V,
            "chi_deg": 0.0 if flight in ("step", "ramp") else 60.0,
            "duration_s": 40.0 if flight in ("step", "ramp") else 50.0,
        },
        "reference": {"gamma_deg": 0.0} | reference,
        "limits": {
            "phi_deg": [-45.0, 45.0],
            "phi_rate_dps": roll,
            "n_z": [low, high],
            "n_z_rate_per_s": lift,
        },
        "controller": {"rate_hz": 50.0, "anti_windup": "conditional", "feed_forward": True},
        "tuning": {"identified": aircraft},
        "plant": [{"kind": "jsbsim", "aircraft": aircraft}],
        **(windy if flight == "wind" else {}),
    }


def nominal(aircraft: str, law: str) -> dict[str, list[float]]:
    """ITAE of course and path angle of each nominal flight, infinite of one that was lost."""
    found = {}
    for flight in ("step",) if running.QUICK else ("step", "ramp", "mission", "wind"):
        (run,) = ft.fly(ft.scenario_from(tables(aircraft, flight, law))).runs[-1:]
        t, errors = run.t, (run.signals[f"{c}_err"].abs() for c in ("chi", "gamma"))
        lost = run.status != "completed"
        found[flight] = [np.inf if lost else float(np.trapezoid(t * e, t)) for e in errors]
    return found


def drawn(aircraft: str, law: str, draws: int) -> dict[str, np.ndarray]:
    """ITAE and largest error (deg) of both channels in each draw, and whether it was lost."""
    flight, *_, campaign = tables(aircraft, "wind", law), AIRCRAFT[aircraft][-1]
    plan = plan_campaign(
        load_campaign(campaign, ft.scenario_from(flight), gains=flight["gains"]).model_copy(
            update={"seed": parser.seed}
        ),
        runs=draws,
    )
    with tempfile.TemporaryDirectory() as folder:
        ft.run_campaign(plan, folder, workers=1)
        rows = open_dataset(folder).rows().to_pandas()
    return {
        "itae": rows[["chi.ITAE", "gamma.ITAE"]].to_numpy(),
        "peak": np.degrees(rows[["chi.peak_rad", "gamma.peak_rad"]].to_numpy()),
        "lost": (rows["status"] != "completed").to_numpy(),
    }


def measure(aircraft: str, draws: int) -> dict[str, dict]:
    """Figures of every law on one aircraft."""
    figures, base = {}, {}
    for law in [BASE, NEW] if parser.two else LAWS:
        flights, draw = nominal(aircraft, law), drawn(aircraft, law, draws)
        base = base or {"flights": flights, "draw": draw}
        over = {
            name: float(np.sqrt(np.prod(np.divide(itae, base["flights"][name]))))
            for name, itae in flights.items()
        }
        ratio = np.sqrt(np.prod(draw["itae"] / base["draw"]["itae"], axis=1))
        ratio = ratio[~draw["lost"]]
        half = np.sort(draw["peak"], axis=0)[-min(2, draws)]
        figures[law] = {
            **over,
            "nominal": float(np.exp(np.mean(np.log([*over.values()])))),
            "draws": float(np.exp(np.mean(np.log(ratio)))),
            "better": int((ratio < 1.0).sum()),
            "chi": float(half[0]),
            "gamma": float(half[1]),
            "lost": int(draw["lost"].sum()),
        }
        if not parser.json:
            shown = " ".join(f"{k} {v:.3g}" for k, v in figures[law].items())
            print(f"{aircraft:10} {law:16} {shown}", flush=True)
    return figures


def missed(aircraft: str, figures: dict[str, dict]) -> list[str]:
    """Targets that the new law misses, in words."""
    new = figures[NEW]
    words = [
        f"{aircraft}: {key} {new[key]:.3f}, at most {most:g}"
        for key, most in TARGETS.get(aircraft, {}).items()
        if not new[key] <= most
    ]
    ahead = [law for law, of_law in figures.items() if of_law["draws"] < new["draws"]]
    words += [f"{aircraft}: {law} is ahead on the draws" for law in ahead]
    return words + [f"{aircraft}: lost {new['lost']} draws"] * (new["lost"] > 0)


def main() -> int:
    aircraft = [parser.aircraft] if parser.aircraft else [*AIRCRAFT][: 1 if running.QUICK else None]
    with code.running(code.Runs.ANY):  # the peers are own laws
        figures = {name: measure(name, 2 if running.QUICK else parser.draws) for name in aircraft}
    words = [word for name in aircraft for word in missed(name, figures[name])]
    print(json.dumps({"figures": figures, "missed": words}) if parser.json else "\n".join(words))
    return 1 if words else 0


if __name__ == "__main__":
    options = running.options(__doc__)
    options.add_argument("--aircraft", choices=[*AIRCRAFT])
    options.add_argument("--draws", type=int, default=93)
    options.add_argument("--two", action="store_true", help="the first law and the new one only")
    options.add_argument("--seed", type=int, default=SEED)
    parser = options.parse_args()
    running.end(main)
