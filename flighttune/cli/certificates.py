"""Commands that certify gains, and check certificates."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.gains import (
    CERTIFICATE_STATUS,
    chosen_gains,
    gains_values,
    margins_table,
)
from flighttune.cli.show import NO, campaign_pool, fail, pick
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

ANY_ENVELOPE = (
    "The certificate holds over any envelope: the error dynamics of the exact law are the same "
    "everywhere."
)
INDICATOR_COLUMNS = [
    Column("units", "units of state"),
    *columns("R_K I_K E_K spectral_abscissa"),
]
EIGENVALUE_COLUMNS = [
    Column("real", "real part", "1/s"),
    Column("imaginary", "imaginary part", "rad/s"),
]
CERTIFICATE_COLUMNS = [
    *CERTIFICATE_STATUS,
    *columns("radius L_d"),
    Column("largest_factor", "largest certified envelope"),
]
if TYPE_CHECKING:
    from flighttune.certificates.make import Certification
    from flighttune.control.gains import PIGains
    from flighttune.control.linear_model import LinearModel
    from flighttune.present.chart import Chart
    from flighttune.scenario import Scenario


def certify(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    envelope: Annotated[
        bool,
        Option("--envelope", help="Certify over the envelope, or at every identified condition."),
    ] = False,
    L_d: Annotated[
        float | None,
        Option(
            "--L-d",
            help="Bound on the derivative of the disturbance, rad/s^2 [default: the scenario's].",
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="File to write the certificate to.")] = None,
    figure: Annotated[
        Path | None,
        Option(help="SVG file to write: Bode and Nyquist diagrams, eigenvalues, certified rate."),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Compute R_K, I_K, E_K and margins of gains on the linear model of SCENARIO, and certify them.

    Exit status 1 if the loop is unstable or no certificate can be proven.
    """
    from flighttune.control.linear_model import closed_loop
    from flighttune.control.margins import loop_margins
    from flighttune.flight.outer_loop import certify_scenario, largest_certified, tuning_scaling
    from flighttune.theory.indicators import indicators

    options.check_ending(figure, ".svg", option="--figure")
    loaded, name, chosen = chosen_gains(scenario, gains, settings)
    law, _ = loaded.law_of(name, chosen)
    identified = law.by_gains and loaded.tuning.model == "identified"
    scaling = largest = None
    if law.by_gains:
        model, flown = loaded.linear_model(law), chosen
        made = certify_scenario(loaded, chosen, envelope=envelope, L_d=L_d, law=law)
        scaling = tuning_scaling(loaded, law)
        if envelope and not (identified or law.same_everywhere):
            largest = largest_certified(loaded, chosen)
    else:
        model, flown, made = _certified_own(loaded, name, chosen, L_d)
    loop = closed_loop(model, flown)
    decay, margins = indicators(loop, errors=len(model.errors)), loop_margins(model, flown)
    if out is not None and made.certificate is not None:
        from flighttune.certificates.certificate import save_certificate

        save_certificate(made.certificate, out)
    if figure is not None:
        from flighttune.present.chart import Sheet
        from flighttune.reports.loop_charts import loop_charts

        charts = _rate_over_envelope(loaded, name, chosen) if largest else []
        title = f"{loaded.title}; gains {name}"
        Sheet(charts=[*loop_charts(model, flown, margins), *charts], title=title).save(figure)
    certificate = made.values
    plain = pick(decay, "R_K I_K E_K scaling spectral_abscissa")
    units, scaled = [{"units": "plain", **plain}], None
    if scaling is not None:
        scaled = pick(indicators(loop, scaling=scaling), "R_K I_K scaling")
        robust = identified and loaded.tuning.robust
        place = ", at the nominal condition" if robust else ""
        units.append({"units": f"scaled by [tuning]{place}", **scaled})
    over = {"R_K": certificate["rate"], "largest_factor": largest} if envelope else None
    poles = [{"real": pole.real, "imaginary": pole.imag} for pole in decay.eigenvalues]
    failure = ""
    if decay.status != "stable":
        failure = f"{scenario}: gains {name}: {decay.reason}"
    elif made.status != "certified" and (envelope or out is not None or not law.by_gains):
        failure = f"{scenario}: gains {name}: {made.reason}"
    return Answer(
        values={
            **pick(decay, "status reason"),
            **plain,
            "eigenvalues": [[pole.real, pole.imag] for pole in decay.eigenvalues],
            "Q": decay.Q,
            "scaled": scaled,
            "gains": name,
            **gains_values(chosen),
            "certificate": certificate,
            "envelope": over,
        },
        tables=[
            Table(INDICATOR_COLUMNS, units, f"{name}: {decay.status}"),
            Table(EIGENVALUE_COLUMNS, poles, "eigenvalues"),
            margins_table(margins),
            Table(CERTIFICATE_COLUMNS, [{**certificate, "largest_factor": largest}], "certificate"),
        ],
        notes=[ANY_ENVELOPE] if envelope and law.same_everywhere and not identified else [],
        verdict=f"proven {certificate['holds']}: s'Qs falls at the rate of the certificate"
        if made.certificate
        else f"no certificate: {made.reason}",
        files={"proof": out if made.certificate else None, "figure": figure},
        failure=failure,
    )


def _certified_own(
    scenario: "Scenario", name: str, gains: "PIGains", L_d: float | None
) -> "tuple[LinearModel, PIGains, Certification]":
    """Linear model and gains of a user's own law, and their certification."""
    from flighttune.certificates.make import certify as certify_model
    from flighttune.flight.outer_loop import linear_loop
    from flighttune.flight.own import with_own

    linear = linear_loop(with_own(scenario), name, gains)
    if linear is None:
        fail(f"{name}: the law must have `linear()` to be certified, got none.", NO)
    return *linear, certify_model(*linear, L_d=L_d, scenario_sha256=scenario.sha256)


def _rate_over_envelope(scenario: "Scenario", name: str, gains: "PIGains") -> "list[Chart]":
    from flighttune.flight.outer_loop import trim_and_envelope
    from flighttune.tuning.envelope import rate_chart, rate_curve

    trim, envelope = trim_and_envelope(scenario)
    curve = rate_curve(gains, envelope, trim, g=scenario.flight.g_mps2)
    return [rate_chart({name: curve}, envelope)]


def verify(
    file: Annotated[
        Path, Argument(metavar="FILE", help="Certificate, bound on R_K, proof of a tube, or band.")
    ],
    conformance: Annotated[
        Path | None,
        Option(help="File of `flighttune conform` that confirms the boxes of an aircraft's tube."),
    ] = None,
    run_code: Annotated[
        bool,
        Option("--run-code", help="Fly flights of a band again that run Python files it names."),
    ] = False,
) -> Answer:
    """Check the claim in a file: certificate, bound on R_K, tube or band.

    Proofs are checked without the solver or the search that found them. The claim of a band is
    computed again from its plan and what its file keeps of each flight. A few flights, chosen at
    random, are flown again; `flighttune refly FILE --count K` flies more.

    Exit status 1 if it does not support what it claims.
    """
    from flighttune.campaign.claims import verify as verify_claim

    with campaign_pool(1, None) as pool:
        checked = verify_claim(file, conformance=conformance, run_code=run_code, pool=pool)
    return checked.answer()
