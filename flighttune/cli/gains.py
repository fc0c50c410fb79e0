"""Commands that find gains, and say what is known about them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import NO, JsonOption, ScenarioArgument, fail, print_json, print_table, say

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.scenario import Scenario


def tune(scenario: ScenarioArgument, as_json: JsonOption = False) -> None:
    """Find the gains with the largest R_K under the constraints of SCENARIO."""
    from flighttune.flight import tune_scenario
    from flighttune.scenario import load_scenario

    result = tune_scenario(load_scenario(scenario))
    if as_json:
        print_json(
            {
                "status": result.status,
                "reason": result.reason,
                **_gains_json(result.gains),
                "R_K": result.R_K,
                "I_K": result.I_K,
                "spectral_abscissa": result.spectral_abscissa,
                "active": list(result.active),
                "starts": result.starts,
                "wall_s": result.wall_s,
            }
        )
    else:
        print_table(
            f"{result.status}: R_K {result.R_K:.5f}, I_K {result.I_K:.4f}, "
            f"spectral abscissa {result.spectral_abscissa:.4f} 1/s",
            ("", "e_chi", "e_gamma", "int e_chi", "int e_gamma"),
            [
                (name, *(f"{round(value, 4) + 0.0:.4f}" for value in row))
                for name, row in zip(("phi [rad]", "n_z [1]"), result.gains.K, strict=True)
            ]
            if result.gains is not None
            else [],
        )
        say(
            f"binding: {', '.join(result.active) or 'nothing'}; {result.starts} starts, "
            f"{result.wall_s:.2f} s"
        )
    if result.status != "optimal":
        fail(f"{scenario}: {result.reason}", NO)


def certify(
    scenario: ScenarioArgument,
    gains: Annotated[
        str | None,
        typer.Option(
            help="A gain set (paper, K1..K6, tuned, or a name of the scenario) or a file "
            "with K_P and K_I; by default the scenario's first."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """R_K and I_K of gains on the linear model of SCENARIO; exit status 1 if unstable."""
    from flighttune.control.closed_loop import closed_loop
    from flighttune.scenario import load_scenario
    from flighttune.theory.indicators import indicators

    loaded = load_scenario(scenario)
    name, chosen = _chosen_gains(loaded, gains)
    found = indicators(closed_loop(loaded.linear_model(), chosen))
    if as_json:
        print_json(
            {
                "status": found.status,
                "reason": found.reason,
                "R_K": found.R_K,
                "I_K": found.I_K,
                "spectral_abscissa": found.spectral_abscissa,
                "eigenvalues": [[value.real, value.imag] for value in found.eigenvalues.tolist()],
                "Q": None if found.Q is None else found.Q.tolist(),
                "gains": name,
                **_gains_json(chosen),
            }
        )
    else:
        print_table(
            f"{name}: {found.status}",
            ("R_K [1/s]", "I_K [s^2]", "spectral abscissa [1/s]", "eigenvalues [1/s]"),
            [
                (
                    f"{found.R_K:.4f}",
                    f"{found.I_K:.4f}",
                    f"{found.spectral_abscissa:.4f}",
                    "  ".join(f"{value:.3f}" for value in found.eigenvalues),
                )
            ],
        )
    if found.status != "stable":
        fail(f"{scenario}: gains {name}: {found.reason}", NO)


def _chosen_gains(scenario: "Scenario", wanted: str | None) -> tuple[str, "PIGains"]:
    from flighttune.errors import InputError
    from flighttune.flight import gain_set
    from flighttune.scenario import load_gains

    if wanted is None:
        first = scenario.gains[0]
        wanted = first if isinstance(first, str) else first.name
    if Path(wanted).suffix.lower() in (".json", ".toml"):
        return wanted, load_gains(wanted)
    gains = gain_set(scenario, wanted)
    if gains is None:
        raise InputError(f"--gains: `{wanted}` must be feasible: tuning found no such gains.")
    return wanted, gains


def _gains_json(gains: "PIGains | None") -> dict[str, Any]:
    if gains is None:
        return {"K_P": None, "K_I": None}
    return {"K_P": gains.K_P.tolist(), "K_I": gains.K_I.tolist()}
