"""Commands that certify gains, and check certificates."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flighttune.cli.gain_sets import (
    chosen_gains,
    gains_json,
    margins_json,
    margins_of,
    margins_text,
)
from flighttune.cli.options import GainsOption, ScenarioArgument, check_ending
from flighttune.cli.show import NO, emit, fail, pick, table
from flighttune.errors import InputError
from flighttune.present.tables import Bad, Table

EIGENVALUES_A_LINE = 4

if TYPE_CHECKING:
    from flighttune.certificates import Certificate, Certification, Claim
    from flighttune.control.gains import PIGains
    from flighttune.control.law import Law
    from flighttune.control.linear_model import LinearModel
    from flighttune.control.margins import LoopMargins
    from flighttune.present.chart import Chart
    from flighttune.scenario import Scenario
    from flighttune.theory.indicators import Indicators


def certify(
    scenario: ScenarioArgument,
    gains: GainsOption = None,
    envelope: Annotated[
        bool,
        Option(
            "--envelope",
            help="Certify the rate over the scenario's envelope or, with the identified model, at "
            "every identified condition.",
        ),
    ] = False,
    L_d: Annotated[
        float | None,
        Option(
            "--L-d",
            help="Bound on the disturbance's derivative in rad/s^2, to certify an ultimate radius "
            "[default: that of the scenario's disturbance].",
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="File to write the certificate to.")] = None,
    figure: Annotated[
        Path | None,
        Option(
            help="SVG file to write: Bode and Nyquist diagrams with margins, eigenvalues; with "
            "--envelope also the certified rate over the size of the envelope."
        ),
    ] = None,
) -> None:
    """Compute R_K, I_K and margins of gains on the linear model of SCENARIO, and certify them.

    Exit status 1 if the loop is unstable or no certificate can be proven.
    """
    from flighttune.control.linear_model import closed_loop
    from flighttune.flight.outer_loop import certify_scenario, largest_certified, tuning_scaling
    from flighttune.scenario import load_scenario
    from flighttune.theory.indicators import indicators

    check_ending(figure, ".svg", option="--figure")
    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
    law, _ = loaded.law_of(name, chosen)
    own = not law.by_gains
    identified = not own and loaded.tuning.model == "identified"
    if own:
        model, flown, made = _certified_own(loaded, name, chosen, L_d)
    else:
        model, flown = loaded.linear_model(law), chosen
        made = certify_scenario(loaded, chosen, envelope=envelope, L_d=L_d, law=law)
    found = indicators(closed_loop(model, flown))
    scaling = None if own else tuning_scaling(loaded, law)
    in_tune = None if scaling is None else indicators(closed_loop(model, flown), scaling=scaling)
    may_grow = envelope and not (own or identified or law.same_everywhere)
    largest = largest_certified(loaded, chosen) if may_grow else None
    _save(made, out)
    margins = margins_of(model, flown)
    if figure is not None:
        more = [_rate_over_envelope(loaded, name, chosen)] if largest and largest.factor else []
        _draw(f"{loaded.title}; gains {name}", model, flown, margins, figure, more)
    answer = {
        **pick(found, "status reason R_K I_K scaling spectral_abscissa eigenvalues Q"),
        "scaled": in_tune and pick(in_tune, "R_K I_K scaling"),
        "gains": name,
        **gains_json(chosen),
        "margins": margins_json(margins),
        "certificate": _certification_json(made, out),
        "figure": figure,
        "envelope": {
            "R_K": made.certificate and made.certificate.claim.rate,
            "largest_factor": largest and largest.factor,
        }
        if envelope
        else None,
    }

    def text() -> Iterator[Table | str]:
        yield from _indicators_text(name, found)
        if in_tune is None:
            yield "units of state: plain, as in `tune`"
        else:
            worst = " here, `tune` has the worst condition"
            yield (
                f"units of state: plain; in the scaled ones of `tune` R_K is {in_tune.R_K:.5f}, "
                f"I_K {in_tune.I_K:.4f}{worst if identified and loaded.tuning.robust else ''}"
            )
        yield from margins_text(margins)
        where = _where(law, identified=identified) if envelope else "at the trim"
        yield _certification_text(made, "on its own linear model" if own else where)
        if out is not None and made.certificate is not None:
            yield f"certificate: {out}   (check it with: flighttune verify {out})"
        if figure is not None:
            yield f"figure: {figure}"
        if largest is not None:
            yield f"largest certified envelope: {largest.factor:.3f} times the scenario's"

    emit(answer, text())
    if found.status != "stable":
        fail(f"{scenario}: gains {name}: {found.reason}", NO)
    if made.status != "certified" and (own or envelope or out is not None):
        fail(f"{scenario}: gains {name}: {made.reason}", NO)


def _where(law: "Law", *, identified: bool) -> str:
    """Where a claim over an envelope holds."""
    if identified:
        return "at every condition identified"
    if law.same_everywhere:
        return (
            f"over any envelope: the error dynamics of the {law.kind} law are the same everywhere"
        )
    return "over the envelope"


def _save(made: "Certification", out: Path | None) -> None:
    from flighttune.certificates import save_certificate

    if out is not None and made.certificate is not None:
        save_certificate(made.certificate, out)


def _certified_own(
    scenario: "Scenario", name: str, gains: "PIGains", L_d: float | None
) -> "tuple[LinearModel, PIGains, Certification]":
    """Model and gains that a law of the user's gives itself, and what is proven of them."""
    from flighttune.certificates import certify as certify_model
    from flighttune.flight.fly import linear_loop
    from flighttune.flight.own import with_own

    linear = linear_loop(with_own(scenario), name, gains)
    if linear is None:
        fail(f"{name}: the law must have `linear()` to be certified, got none.", NO)
    return *linear, certify_model(*linear, L_d=L_d, scenario_sha256=scenario.sha256)


def _draw(
    title: str,
    model: "LinearModel",
    gains: "PIGains",
    margins: "LoopMargins | None",
    file: Path,
    more: "Sequence[Chart]" = (),
) -> None:
    from flighttune.present.chart import Sheet
    from flighttune.report.loop_charts import loop_charts

    Sheet(charts=[*loop_charts(model, gains, margins), *more], title=title).save(file)


def _rate_over_envelope(scenario: "Scenario", name: str, gains: "PIGains") -> "Chart":
    from flighttune.flight.outer_loop import trim_and_envelope
    from flighttune.tuning.envelope import rate_chart, rate_curve

    trim, envelope = trim_and_envelope(scenario)
    curve = rate_curve(name, gains, envelope, trim, g=scenario.flight.g_mps2)
    return rate_chart([curve], envelope)


def verify(
    certificate: Annotated[Path, Argument(metavar="FILE", help="Certificate, or proof of a tube.")],
    conformance: Annotated[
        Path | None,
        Option(
            help="File of `flighttune conform` from which the boxes in the tube of an aircraft are "
            "rebuilt [default: they are believed, and the answer says so]."
        ),
    ] = None,
) -> None:
    """Check a certificate without any solver, or a tube without the search that found it.

    Exit status 1 if it does not prove what it claims.
    """
    from flighttune.tube.proof import is_tube_file

    if is_tube_file(certificate):
        _verify_tube(certificate, conformance)
        return
    if conformance is not None:
        raise InputError("`--conformance` must be given for the tube of an aircraft only.")
    from flighttune.certificates import load_certificate
    from flighttune.certificates import verify as verify_certificate

    loaded = load_certificate(certificate)
    found = verify_certificate(loaded)
    verdict = "valid: every inequality is proven" if found.valid else "not valid"
    rows = [
        (one.name, f"{one.margin:.3e}", "proven" if one.exact else Bad("broken"))
        for one in found.checks
    ]
    model = loaded.model
    claim = {
        **_claim_json(loaded.claim),
        "envelope": loaded.claim.envelope,
        "g": loaded.claim.g,
        "gains": pick(loaded.gains, "inputs errors K_P K_I"),
        "model": pick(model, "states inputs errors A B C"),
    }
    text = [
        table(f"{certificate}: {verdict}", ("check", "margin", "exact"), rows),
        f"{'proven' if found.valid else 'claimed, not proven'}: {_claim_text(loaded)}",
        table(
            "with the gains",
            ("", *(f"{kind}e_{error}" for kind in ("", "int ") for error in model.errors)),
            [
                (name, *(f"{value:.6g}" for value in row))
                for name, row in zip(model.inputs, loaded.gains.K, strict=True)
            ],
        ),
    ]
    emit({**pick(found, "valid reason checks"), "claim": claim}, text)
    if not found.valid:
        fail(f"{certificate}: {found.reason}", NO)


def _verify_tube(file: Path, conformance: Path | None) -> None:
    from flighttune.cli.tube import NOT_CHECKED, for_ever_text, problem_text, tube_json, widths_text
    from flighttune.conformance import load_conformance
    from flighttune.tube.proof import load_tube, verify_tube

    loaded = load_tube(file, conformance and load_conformance(conformance))
    found, checked = verify_tube(loaded), loaded.problem.aircraft_checked
    verdict = "valid: every inclusion is proven" if found.valid else "not valid"
    basis = "proven" if loaded.lost is None else "proven, within the errors that were counted"
    if checked is False:
        basis = f"proven {NOT_CHECKED}"
    rows = [(one.name, f"{one.margin:.3e}") for one in found.checks]
    claim = {**tube_json(loaded), "scenario": loaded.problem.scenario.as_dict()}
    text = [
        table(f"{file}: {verdict}", ("check", "margin"), rows),
        f"{basis if found.valid else 'claimed, not proven'}:",
        widths_text(loaded, "of the file"),
        *problem_text(loaded),
        for_ever_text(loaded),
    ]
    emit({**pick(found, "valid reason checks"), "aircraft_checked": checked, "claim": claim}, text)
    if not found.valid:
        fail(f"{file}: {found.reason}", NO)


def _certification_json(made: "Certification", out: Path | None) -> dict[str, Any]:
    claim = made.certificate and made.certificate.claim
    return {
        **pick(made, "status reason"),
        **_claim_json(claim),
        "checks": made.verification.checks if made.verification else [],
        "file": claim and out,
    }


def _claim_json(claim: "Claim | None") -> dict[str, Any]:
    return {
        **(pick(claim, "rate radius L_d") if claim else dict.fromkeys(("rate", "radius", "L_d"))),
        "holds": claim and claim.place,
        "conditions": [
            {"V_a_mps": V_a, "gamma_rad": gamma}
            for V_a, gamma in (claim.conditions if claim else ())
        ],
    }


def _claim_text(certificate: "Certificate") -> str:
    """What a certificate claims, from the numbers that its check uses."""
    claim, states = certificate.claim, ", ".join(certificate.model.states)
    if claim.envelope is not None:
        where = f"{claim.place}, g {claim.g:g} m/s²: for every flight of the law that stays in it"
    elif claim.conditions:
        where = f"for the models in the file (states {states}), given as those {claim.place}"
    else:
        where = f"for the linear model in the file (states {states})"
    radius = (
        ""
        if claim.radius is None
        else f"; the norm of s ends below {claim.radius:.6g} under a disturbance whose derivative "
        f"stays below {claim.L_d:.6g}"
    )
    return f"s'Qs falls at {claim.rate:.6g} 1/s{radius}; {where}"


def _indicators_text(name: str, found: "Indicators") -> Iterator[Table | str]:
    yield table(
        f"{name}: {found.status}",
        ("R_K [1/s]", "I_K [s²]", "spectral abscissa [1/s]"),
        [(f"{found.R_K:.4f}", f"{found.I_K:.4f}", f"{found.spectral_abscissa:.4f}")],
    )
    values = [f"{value:.3f}" for value in found.eigenvalues]
    head = "eigenvalues [1/s]:"
    for start in range(0, len(values), EIGENVALUES_A_LINE):
        yield "  ".join([head, *values[start : start + EIGENVALUES_A_LINE]])
        head = " " * len(head)


def _certification_text(made: "Certification", asked: str) -> str:
    import numpy as np

    if made.certificate is None:
        return f"no certificate {asked}: {made.reason}"
    claim = made.certificate.claim
    where = claim.place if claim.conditions else asked
    checks = len(made.verification.checks) if made.verification else 0
    radius = "" if claim.radius is None else f", ultimate radius {claim.radius:.5f} rad"
    spread = math.sqrt(float(np.linalg.cond(made.certificate.Q)))
    return (
        f"proven {where}: s'Qs falls at {claim.rate:.5f} 1/s, so the norm of s at "
        f"{claim.rate / 2.0:.5f} 1/s from at most {spread:.2f} times its start{radius} "
        f"({checks} exact checks)"
    )
