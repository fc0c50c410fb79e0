"""Commands that certify gains, and check certificates."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_pool
from flighttune.present.answer import Answer


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
    from flighttune.files.value import write
    from flighttune.flight.gains import certify as certify_gains

    options.check_ending(figure, ".svg", option="--figure")
    certified = certify_gains(
        scenario, gains, envelope=envelope, L_d=L_d, changes=options.changes(settings)
    )
    proof = out if certified.certificate else None
    if certified.certificate is not None and out is not None:
        write(certified.certificate, out)
    if figure is not None:
        from flighttune.reports.loop_charts import loop_sheet

        title = f"{Path(scenario).stem}; gains {certified.name}"
        loop_sheet(certified, title).save(figure)
    return replace(certified.answer(), files={"proof": proof, "figure": figure})


def verify(
    file: Annotated[
        Path, Argument(metavar="FILE", help="Certificate, bound on R_K, proof of a tube, or band.")
    ],
    boxes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of `flighttune band --of residual` that confirms the boxes of a tube.",
        ),
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
        checked = verify_claim(file, boxes=boxes, run_code=run_code, pool=pool)
    return checked.answer()
