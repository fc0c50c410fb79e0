"""Commands that certify gains, and check certificates."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli.gain_sets import chosen_gains, gains_table, gains_values, margins_table
from flighttune.cli.options import GainsOption, ScenarioArgument, check_ending
from flighttune.cli.show import NO, emit, fail, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

ANY_ENVELOPE = (
    "The certificate holds over any envelope: the error dynamics of the exact law are the same "
    "everywhere."
)
INDICATOR_COLUMNS = [
    Column("units", "units of state"),
    *columns("R_K I_K spectral_abscissa"),
]
EIGENVALUE_COLUMNS = [
    Column("real", "real part", "1/s"),
    Column("imaginary", "imaginary part", "rad/s"),
]
CERTIFICATE_COLUMNS = [
    *columns("status rate growth radius L_d"),
    Column("largest_factor", "largest certified envelope"),
]
CHECK_COLUMNS = [Column("name", "check"), *columns("margin exact")]

if TYPE_CHECKING:
    from flighttune.certificates import Certificate, Certification
    from flighttune.control.gains import PIGains
    from flighttune.control.linear_model import LinearModel
    from flighttune.present.chart import Chart
    from flighttune.scenario import Scenario


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
    from flighttune.control.margins import loop_margins
    from flighttune.flight.outer_loop import certify_scenario, largest_certified, tuning_scaling
    from flighttune.report.certified import certification_values
    from flighttune.scenario import load_scenario
    from flighttune.theory.indicators import indicators

    check_ending(figure, ".svg", option="--figure")
    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
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
    decay, margins = indicators(loop), loop_margins(model, flown)
    if out is not None and made.certificate is not None:
        from flighttune.certificates import save_certificate

        save_certificate(made.certificate, out)
    if figure is not None:
        from flighttune.present.chart import Sheet
        from flighttune.report.loop_charts import loop_charts

        charts = _rate_over_envelope(loaded, name, chosen) if largest else []
        title = f"{loaded.title}; gains {name}"
        Sheet(charts=[*loop_charts(model, flown, margins), *charts], title=title).save(figure)
    certificate = certification_values(made)
    plain = pick(decay, "R_K I_K scaling spectral_abscissa")
    units, scaled = [{"units": "plain", **plain}], None
    if scaling is not None:
        scaled = pick(indicators(loop, scaling=scaling), "R_K I_K scaling")
        robust = identified and loaded.tuning.robust
        place = ", at the nominal condition" if robust else ""
        units.append({"units": f"scaled by [tuning]{place}", **scaled})
    over = {"R_K": certificate["rate"], "largest_factor": largest} if envelope else None
    poles = [{"real": pole.real, "imaginary": pole.imag} for pole in decay.eigenvalues]
    claimed = [{**certificate, "largest_factor": largest}]
    emit(
        Answer(
            values={
                **pick(decay, "status reason"),
                **plain,
                **pick(decay, "eigenvalues Q"),
                "scaled": scaled,
                "gains": name,
                **gains_values(chosen),
                "certificate": certificate,
                "envelope": over,
            },
            tables=[
                Table(title=f"{name}: {decay.status}", columns=INDICATOR_COLUMNS, records=units),
                Table(title="eigenvalues", columns=EIGENVALUE_COLUMNS, records=poles),
                margins_table(margins),
                Table(title="certificate", columns=CERTIFICATE_COLUMNS, records=claimed),
            ],
            notes=[ANY_ENVELOPE] if envelope and law.same_everywhere and not identified else [],
            verdict=f"proven {certificate['holds']}: s'Qs falls at the rate of the certificate"
            if made.certificate
            else f"no certificate: {made.reason}",
            files={"proof": out if made.certificate else None, "figure": figure},
        )
    )
    if decay.status != "stable":
        fail(f"{scenario}: gains {name}: {decay.reason}", NO)
    if made.status != "certified" and (envelope or out is not None or not law.by_gains):
        fail(f"{scenario}: gains {name}: {made.reason}", NO)


def _certified_own(
    scenario: "Scenario", name: str, gains: "PIGains", L_d: float | None
) -> "tuple[LinearModel, PIGains, Certification]":
    """Linear model and gains of a user's own law, and their certification."""
    from flighttune.certificates import certify as certify_model
    from flighttune.flight.fly import linear_loop
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
    from flighttune.report.certified import claim_values

    loaded = load_certificate(certificate)
    verification = verify_certificate(loaded)
    verdict = "valid: every inequality is proven" if verification.valid else "not valid"
    checks = [asdict(check) for check in verification.checks]
    claim = {
        **claim_values(loaded.claim),
        "envelope": loaded.claim.envelope,
        "g": loaded.claim.g,
        "gains": pick(loaded.gains, "inputs errors K_P K_I"),
        "model": pick(loaded.model, "states inputs errors A B C"),
    }
    title = f"{certificate}: {verdict}"
    emit(
        Answer(
            values={**pick(verification, "valid reason"), "claim": claim},
            tables=[
                Table(title=title, name="checks", columns=CHECK_COLUMNS, records=checks),
                Table(title="claim", columns=columns("rate radius L_d"), records=[claim]),
                gains_table("gains", loaded.gains),
            ],
            verdict=_where(loaded)
            if verification.valid
            else f"claimed, not proven: {_where(loaded)}",
        )
    )
    if not verification.valid:
        fail(f"{certificate}: {verification.reason}", NO)


def _verify_tube(file: Path, conformance: Path | None) -> None:
    from flighttune.cli.tube import NOT_CHECKED, bounds_after, problem_tables, tube_values
    from flighttune.conformance import load_conformance
    from flighttune.tube.proof import load_tube, verify_tube

    loaded = load_tube(file, None if conformance is None else load_conformance(conformance))
    verification, checked = verify_tube(loaded), loaded.problem.aircraft_checked
    verdict = "valid: every inclusion is proven" if verification.valid else "not valid"
    basis = "proven" if loaded.lost is None else "proven, within the errors that were counted"
    if checked is False:
        basis = f"proven {NOT_CHECKED}"
    values = tube_values(loaded)
    checks = [asdict(check) for check in verification.checks]
    title = f"{file}: {verdict}"
    emit(
        Answer(
            values={
                **pick(verification, "valid reason"),
                "aircraft_checked": checked,
                "claim": {**values, "scenario": loaded.problem.scenario.as_dict()},
            },
            tables=[
                Table(title=title, name="checks", columns=CHECK_COLUMNS[:2], records=checks),
                *problem_tables(loaded, values, "of the file"),
            ],
            notes=bounds_after(loaded),
            verdict=basis if verification.valid else "claimed, not proven",
        )
    )
    if not verification.valid:
        fail(f"{file}: {verification.reason}", NO)


def _where(certificate: "Certificate") -> str:
    """The flights or models for which the claim of a certificate holds, in words."""
    claim, states = certificate.claim, ", ".join(certificate.model.states)
    if claim.envelope is not None:
        return f"{claim.place}, g {claim.g:g} m/s²: for every flight of the law that stays in it"
    if claim.conditions:
        return f"for the models in the file (states {states}), given as those {claim.place}"
    return f"for the linear model in the file (states {states})"
