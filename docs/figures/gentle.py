"""The table of calmer commands in docs/exact_law.md: ``python docs/figures/gentle.py [FLIGHTS]``.

It flies both gain sets on the circuit of each aircraft, FLIGHTS (8) times in light turbulence and
in still air.
"""

import sys

import numpy as np

import flighttune as ft

AIRCRAFT = {
    "Aerosonde": "circuit",
    "c172p": "circuit_c172p",
    "X8": "circuit_x8",
    "A-4": "circuit_a4",
}
SETS = "tuned_fed_back", "tuned_gentle"
RATES = "phi_cmd", "n_z_cmd", "aileron", "elevator"
FIRST_SEED, WIND_MPS, TURN_DEG = 101, 5.0, 37.0


def measures(run: ft.Run) -> np.ndarray:
    """Mean squares of the rates, then ITAE of the course and 95 % distances from the path."""
    assert run.status == "completed", run.outcome
    signals = run.signals
    rates = [float(np.mean(np.diff(signals[name]) ** 2)) for name in RATES]
    itae = float(np.mean(run.t * np.abs(signals["chi_err"])))
    sizes = [float(np.quantile(np.abs(signals[x]), 0.95)) for x in ("cross_track", "height_err")]
    return np.array([*rates, itae, *sizes])


def flown(name: str, seed: int, *, windy: bool) -> list[np.ndarray]:
    """Measures of both gain sets in one flight's air and errors of navigation."""
    changes = {"navigation": {"grade": "standard"}, "gains": [*SETS], "seed": seed, "expect": []}
    if windy:
        wind = {"speed_mps": WIND_MPS, "from_deg": seed * TURN_DEG % 360.0}
        changes |= {"turbulence": {"intensity": "light"}, "wind": wind}
    scenario = ft.load_scenario(name, changes=changes)
    aircraft = [plant for plant in scenario.plant if plant.kind == "jsbsim"]
    runs = ft.fly(scenario.model_copy(update={"plant": aircraft})).runs
    return [measures(run) for run in runs]


def changed(name: str, flights: int, *, windy: bool) -> np.ndarray:
    """Change from the first gain set to the second, %."""
    seeds = range(FIRST_SEED, FIRST_SEED + flights)
    quick, gentle = np.mean([flown(name, seed, windy=windy) for seed in seeds], axis=0)
    ratio = gentle / quick
    ratio[: len(RATES)] = np.sqrt(ratio[: len(RATES)])
    return 100.0 * (ratio - 1.0)


def main() -> None:
    """Print the rows of the table, with the two distances at their end."""
    flights = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    for aircraft, name in AIRCRAFT.items():
        pairs = zip(*(changed(name, flights, windy=windy) for windy in (True, False)), strict=True)
        print(f"| {aircraft} |", " | ".join(f"{a:+.0f}, {b:+.0f}" for a, b in pairs), flush=True)


if __name__ == "__main__":
    main()
