"""Commands that say what is guaranteed of gains, and check what others say."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.gain_sets import (
    GainsOption,
    chosen_gains,
    gains_json,
    margins_json,
    margins_of,
    say_margins,
)
from flighttune.cli.show import NO, JsonOption, ScenarioArgument, fail, print_json, print_table, say

EIGENVALUES_A_LINE = 4

if TYPE_CHECKING:
    from flighttune.certificates import Certification, Verification
    from flighttune.theory.indicators import Indicators


def certify(
    scenario: ScenarioArgument,
    gains: GainsOption = None,
    envelope: Annotated[
        bool,
        typer.Option(
            "--envelope",
            help="Claim the rate over the scenario's envelope; with the identified model: at every "
            "condition identified.",
        ),
    ] = False,
    L_d: Annotated[
        float | None,
        typer.Option(
            "--L-d",
            help="Bound of the disturbance's derivative in rad/s^2, for a claim on the ultimate "
            "radius; by default that of the scenario's disturbance.",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write a certificate to this file.")] = None,
    as_json: JsonOption = False,
) -> None:
    """R_K, I_K, margins and a certificate of gains on the linear model of SCENARIO.

    Exit status 1 if the loop is unstable or the certificate is refused.
    """
    from flighttune.control.closed_loop import closed_loop
    from flighttune.outer_loop import certify_scenario, largest_certified, tuning_scaling
    from flighttune.scenario import load_scenario
    from flighttune.theory.indicators import indicators

    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
    model = loaded.linear_model()
    found = indicators(closed_loop(model, chosen))
    scaling = tuning_scaling(loaded)
    in_tune = None if scaling is None else indicators(closed_loop(model, chosen), scaling=scaling)
    made = certify_scenario(loaded, chosen, envelope=envelope, L_d=L_d)
    identified = loaded.tuning.model == "identified"
    reach = largest_certified(loaded, chosen) if envelope and not identified else None
    if out is not None and made.certificate is not None:
        from flighttune.certificates import save_certificate

        save_certificate(made.certificate, out)
    claimed = None if made.certificate is None else made.certificate.claim.rate
    margins = margins_of(model, chosen)
    if as_json:
        print_json(
            {
                **_indicators_json(found),
                "scaled": None if in_tune is None else _scaled_json(in_tune),
                "gains": name,
                **gains_json(chosen),
                "margins": margins_json(margins),
                "certificate": _certification_json(made, out),
                "envelope": None
                if not envelope
                else {"R_K": claimed, "largest_factor": None if reach is None else reach.factor},
            }
        )
    else:
        _print_indicators(name, found)
        _say_units(in_tune, robust=identified and loaded.tuning.robust)
        say_margins(margins)
        asked = "at the trim"
        if envelope:
            asked = "at every condition identified" if identified else "over the envelope"
        _say_certification(made, asked, out)
        if reach is not None:
            say(f"largest certified envelope: {reach.factor:.3f} times the scenario's")
    if found.status != "stable":
        fail(f"{scenario}: gains {name}: {found.reason}", NO)
    if made.status != "certified" and (envelope or out is not None):
        fail(f"{scenario}: gains {name}: {made.reason}", NO)


def verify(
    certificate: Annotated[Path, typer.Argument(metavar="FILE", help="A certificate.")],
    as_json: JsonOption = False,
) -> None:
    """Check a certificate without any solver, in floating point and exactly.

    Exit status 1 if it does not prove what it claims.
    """
    from flighttune.certificates import verify as verify_certificate

    found = verify_certificate(certificate)
    if as_json:
        print_json({"valid": found.valid, "reason": found.reason, "checks": _checks_json(found)})
    else:
        rows = [
            (one.name, f"{one.margin:.3e}", "proven" if one.exact else "broken")
            for one in found.checks
        ]
        verdict = "valid: every inequality is proven" if found.valid else "not valid"
        print_table(f"{certificate}: {verdict}", ("check", "margin", "exact"), rows)
    if not found.valid:
        fail(f"{certificate}: {found.reason}", NO)


def _indicators_json(found: "Indicators") -> dict[str, Any]:
    return {
        "status": found.status,
        "reason": found.reason,
        "R_K": found.R_K,
        "I_K": found.I_K,
        "scaling": found.scaling.tolist(),
        "spectral_abscissa": found.spectral_abscissa,
        "eigenvalues": [[value.real, value.imag] for value in found.eigenvalues.tolist()],
        "Q": None if found.Q is None else found.Q.tolist(),
    }


def _scaled_json(found: "Indicators") -> dict[str, Any]:
    return {"R_K": found.R_K, "I_K": found.I_K, "scaling": found.scaling.tolist()}


def _checks_json(found: "Verification") -> list[dict[str, Any]]:
    return [{"name": one.name, "margin": one.margin, "exact": one.exact} for one in found.checks]


def _certification_json(made: "Certification", out: Path | None) -> dict[str, Any]:
    claim = None if made.certificate is None else made.certificate.claim
    return {
        "status": made.status,
        "reason": made.reason,
        "rate": None if claim is None else claim.rate,
        "radius": None if claim is None else claim.radius,
        "L_d": None if claim is None else claim.L_d,
        "holds": None if claim is None else claim.place,
        "conditions": []
        if claim is None
        else [{"V_a_mps": V_a, "gamma_rad": gamma} for V_a, gamma in claim.conditions],
        "checks": [] if made.verification is None else _checks_json(made.verification),
        "file": str(out) if out is not None and claim is not None else None,
    }


def _print_indicators(name: str, found: "Indicators") -> None:
    print_table(
        f"{name}: {found.status}",
        ("R_K [1/s]", "I_K [s²]", "spectral abscissa [1/s]"),
        [(f"{found.R_K:.4f}", f"{found.I_K:.4f}", f"{found.spectral_abscissa:.4f}")],
    )
    values = [f"{value:.3f}" for value in found.eigenvalues]
    for start in range(0, len(values), EIGENVALUES_A_LINE):
        head = "eigenvalues [1/s]:" if start == 0 else " " * len("eigenvalues [1/s]:")
        say("  ".join([head, *values[start : start + EIGENVALUES_A_LINE]]))


def _say_units(in_tune: "Indicators | None", *, robust: bool) -> None:
    if in_tune is None:
        say("units of state: plain, as in `tune`")
        return
    say(
        f"units of state: plain; in the scaled ones of `tune` R_K is {in_tune.R_K:.5f}, "
        f"I_K {in_tune.I_K:.4f}{' here, `tune` has the worst condition' if robust else ''}"
    )


def _say_certification(made: "Certification", asked: str, out: Path | None) -> None:
    import numpy as np

    if made.certificate is None:
        say(f"no certificate {asked}: {made.reason}")
        return
    claim = made.certificate.claim
    where = claim.place if claim.conditions else asked
    checks = 0 if made.verification is None else len(made.verification.checks)
    radius = "" if claim.radius is None else f", ultimate radius {claim.radius:.5f} rad"
    spread = math.sqrt(float(np.linalg.cond(made.certificate.Q)))
    say(
        f"proven {where}: s'Qs falls at {claim.rate:.5f} 1/s, so the norm of s at "
        f"{claim.rate / 2.0:.5f} 1/s from at most {spread:.2f} times its start{radius} "
        f"({checks} exact checks)"
    )
    if out is not None:
        say(f"certificate: {out}   (check it with: flighttune verify {out})")
