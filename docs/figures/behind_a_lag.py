"""The numbers of docs/exact_law.md: what R_K, E_K, the exact rate and the sensitivity say.

``python docs/figures/behind_a_lag.py`` prints them, which takes half a minute.
"""

import math

import numpy as np

import flighttune as ft
from flighttune.control.linear_model import closed_loops
from flighttune.control.theory.indicators import indicators
from flighttune.control.tuning.envelope import FINE, Peaks, channels

IDENTIFIED = {"law": "paper", "tuning.model": "identified"}
SCENARIOS = "level_turn", "gust_in_turn", "turbulent_climb", "crosswind_course", "paper_identified"


def sensitivity(problem: ft.loop.TuningProblem, gains: ft.PIGains) -> float:
    """Largest sensitivity of a channel behind its identified lag."""
    peaks = []
    for inputs, errors, part in channels(problem):
        columns = np.concatenate([errors, len(problem.model.errors) + errors])
        k = gains.K[inputs[:, None], columns][part.free]
        peaks.append(Peaks(part, FINE).logs(k, np.zeros(1)).max())
    return math.exp(max(peaks))


def errors_flown(name: str, law: str, gains: ft.PIGains) -> np.ndarray:
    """ITAE of course and path angle on the Aerosonde, rad s^2."""
    tables = ft.load_scenario(name).as_dict()
    entry = {"name": "mine", "K_P": gains.K_P.tolist(), "K_I": gains.K_I.tolist()}
    tables |= {"expect": [], "gains": [entry]}
    if law != "paper":
        tables["law"] = law
        entry["law"] = law
    flown = ft.fly(ft.scenario_from(tables)).metrics["ITAE"]
    (label,) = {run for run, _ in flown.index if "jsbsim" in run}
    return np.array([flown[label, "chi"], flown[label, "gamma"]])


def main() -> None:
    """Print the rows of the table."""
    plain = ft.load_scenario("mission", changes=IDENTIFIED)
    problem = ft.loop.tuning_problem(plain)
    sets: dict[str, tuple[str, ft.PIGains]] = {"K*, as printed": ("paper", ft.PAPER_GAINS)}
    tunings = {
        "largest R_K on the kinematic law": ("paper", {"tuning.structure": "decoupled"}),
        "largest R_K (`tuned_identified`)": ("paper", IDENTIFIED),
        "least E_K": ("paper", IDENTIFIED | {"tuning.objective": "E_K"}),
        "fastest decay": ("paper", IDENTIFIED | {"tuning.objective": "decay"}),
        "exact law, largest R_K": ("exact", IDENTIFIED),
        "exact law, least E_K": ("exact", IDENTIFIED | {"tuning.objective": "E_K"}),
        "exact law, fastest decay": ("exact", IDENTIFIED | {"tuning.objective": "decay"}),
    }
    for name, (law, changes) in tunings.items():
        chosen = changes if law == "paper" else changes | {"law": law}
        gains = ft.tune("mission", changes=chosen).gains
        assert gains is not None
        sets[name] = law, gains
    least = np.array(
        [errors_flown(name, *sets["largest R_K (`tuned_identified`)"]) for name in SCENARIOS]
    )
    for name, (law, gains) in sets.items():
        changes = IDENTIFIED if law == "paper" else IDENTIFIED | {"law": law}
        made = ft.certify("mission", gains, changes=changes).certificate
        rates = [] if made is None else [rate.rate for rate in made.exact_rates]
        case = (
            problem
            if law == "paper"
            else ft.loop.tuning_problem(ft.load_scenario("mission", changes=changes))
        )
        R_K = indicators(closed_loops(case.model, gains.K), scaling=case.scaling).R_K
        flown = np.array([errors_flown(scenario, law, gains) for scenario in SCENARIOS]) / least
        print(
            f"| {name} | {R_K:.4f} | "
            f"{' / '.join(f'{rate:.2f}' for rate in rates)} | "
            f"{case.largest_errors(gains.K).max():.2f} | {sensitivity(case, gains):.2f} | "
            f"{math.exp(np.log(flown).mean()):.2f} | {flown.max():.2f} |"
        )


if __name__ == "__main__":
    main()
