"""One page on an adopted aircraft: whether it is adopted, how it flies, what was measured."""

from importlib.metadata import version
from pathlib import Path

from flighttune.adopt.adopt import CALM_DEG, GOOD_FIT, TURN, Adoption
from flighttune.aircraft.aircraft import load_aircraft
from flighttune.identify.figure import held_out
from flighttune.identify.file import lags_table
from flighttune.identify.steps import steps_table
from flighttune.present.frame import Section, page_template, write_page
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table, facts_table
from flighttune.report.panels import FLOWN, errors, flown_signals
from flighttune.simulate.run import run_styles

PAGE = "adoption.html"

FLIGHT_COLUMNS = [
    *columns("gains status"),
    Column("ITAE.chi", "ITAE χ", "rad\u00a0s²"),
    Column("ITAE.gamma", "ITAE γ", "rad\u00a0s²"),
    Column("ST_deg.chi", "ST χ", "deg"),
    Column("ST_deg.gamma", "ST γ", "deg"),
]
TRIM_COLUMNS = columns("V_a_mps gamma_deg trim.alpha_deg trim.throttle reason")

SIGNALS = (
    *FLOWN,
    ("V_a", "Airspeed", "V_a [m/s]"),
    ("throttle", "Throttle", "throttle [1]"),
)

CRITERION = (
    f"Adopted means: both fits reach {GOOD_FIT:g} %, the turn is completed, the standard deviation "
    f"of the course error in its last quarter is below {CALM_DEG:g} deg, and the ITAE of both "
    "channels is below that of the paper's gains."
)


def write_adoption(adoption: Adoption) -> Path:
    """Write the page of an aircraft into its folder, and return it."""
    assert adoption.folder is not None
    assert adoption.identified is not None
    assert adoption.turn is not None
    config = load_aircraft(adoption.folder)
    verdict = f"{adoption.status}: {adoption.reason}" if adoption.reason else adoption.status
    styles = run_styles(adoption.turn.runs)
    drawn = [(run, styles[run.label]) for run in adoption.turn.runs if len(run.signals)]
    turn = Section(
        id="turn",
        title=f"The turn: {turn_name(adoption)}",
        note=CRITERION,
        charts=[*errors(drawn), *flown_signals(drawn, SIGNALS)] if drawn else (),
        tables=[flights_table(adoption)],
        columns=3,
    )
    inner_loop = Section(
        id="inner_loop",
        title="The inner loop",
        note="Steps flown against what was asked for, and the manoeuvre that checks the fit.",
        charts=[held_out(adoption.identified.conditions[0], i) for i in range(2)],
        tables=(steps_table(adoption.steps), lags_table(adoption.identified.identified)),
        legend=False,
    )
    trims = Section(
        id="trims",
        title="Where it flies",
        note="Steady flight about the airspeed chosen.",
        tables=[Table(title="Trims", columns=TRIM_COLUMNS, records=adoption.trims)],
        legend=False,
    )
    page = write_page(
        adoption.folder / PAGE,
        page_template("flighttune.adopt", "page.html.jinja"),
        summary=(f"{verdict[0].upper()}{verdict[1:]}.",),
        sections=[turn, inner_loop, trims],
        title=f"{config.title} at {adoption.V_a:.0f} m/s",
        legend=list(styles.items()),
        styles=styles,
        notes=adoption.notes,
        provenance=facts_table(
            "",
            {
                "airspeed": f"{adoption.V_a:.4g} m/s",
                "engines": str(adoption.engines),
                "flighttune": version("flighttune"),
                "JSBSim": version("jsbsim"),
            },
        ),
        name=adoption.name,
        model=config.model,
        V_a=f"{adoption.V_a:.4g}",
        version=version("flighttune"),
        aircraft_text=config.file.read_text(encoding="utf-8"),
        turn_text=(adoption.folder / TURN).read_text(encoding="utf-8"),
    )
    return page.path


def turn_name(adoption: Adoption) -> str:
    """Manoeuvre of the turn of an adoption."""
    return f"course of 20 deg, {'climb' if adoption.engines else 'steeper glide'} of 3 deg"


def flights_table(adoption: Adoption) -> Table:
    """Results of the turn by gain set, as a table."""
    return Table(
        title=f"{adoption.name} at {adoption.V_a:.0f} m/s: {turn_name(adoption)}",
        columns=FLIGHT_COLUMNS,
        records=list(adoption.flown.values()),
    )
