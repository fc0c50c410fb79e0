"""One page on the adoption of an aircraft: verdict, flights and measurements."""

import tomllib
from importlib.metadata import version
from pathlib import Path

from flighttune.outputs.answers.adoption import turn_table
from flighttune.outputs.answers.answer import Table, facts_table
from flighttune.outputs.answers.design import steps_table
from flighttune.outputs.answers.identification import held_out
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.answers.tables import lags_table
from flighttune.outputs.pages.frame import Section, write_answer
from flighttune.outputs.pages.panels import errors, flown_signals
from flighttune.studies.adoption.adopt import AIRCRAFT, CALM_DEG, PAGE, TURN, Adoption
from flighttune.vehicles.identification.identify import GOOD_FIT

TRIM_COLUMNS = columns("V_a_mps gamma_deg trim.alpha_deg trim.throttle reason")

SIGNALS = "phi n_z V_a throttle"

CRITERION = (
    f"Adopted means: both fits reach {GOOD_FIT:g} %, the turn is completed, the standard deviation "
    f"of course and path angle in its last quarter is at most {CALM_DEG:g} deg, and the ITAE of "
    "both channels is below that of the paper's gains."
)


def write_adoption(adoption: Adoption) -> Path:
    """Write the page of an aircraft into its folder, and return it."""
    assert adoption.folder is not None
    assert adoption.identified is not None
    assert adoption.turn is not None
    tables = tomllib.loads(adoption.texts[AIRCRAFT])  # its file may still be staged
    answer = adoption.answer()
    styles = run_styles(adoption.turn.runs)
    flights = [(run, styles[run.label]) for run in adoption.turn.runs if len(run.signals)]
    flown = {"airspeed": f"{adoption.V_a:.4g} m/s", "engines": str(adoption.engines)}
    made_with = {"flighttune": version("flighttune"), "JSBSim": version("jsbsim")}
    page = write_answer(
        adoption.folder / PAGE,
        title=f"{tables['title']} at {adoption.V_a:.0f} m/s",
        summary=[*filter(None, [answer.failure or answer.verdict, *adoption.notes])],
        parts={
            "requirements": Section(note=CRITERION, tables=[turn_table(adoption)], legend=False),
            "responses": Section(
                title="The turn: errors and signals",
                note=adoption.turn_name,
                charts=[*errors(flights), *flown_signals(flights, SIGNALS)] if flights else (),
                columns=3,
            ),
            "inner_loop": Section(
                title="The inner loop",
                note="Steps flown against what was asked for, and the manoeuvre that checks the "
                "fit.",
                charts=[held_out(adoption.identified.conditions[0], i) for i in range(2)],
                tables=(steps_table(adoption.steps), lags_table(adoption.identified.identified)),
                legend=False,
            ),
            "trims": Section(
                title="Where it flies",
                note="Steady flight about the airspeed chosen.",
                tables=[Table(TRIM_COLUMNS, adoption.trims, "Trims")],
                legend=False,
            ),
        },
        legend=list(styles.items()),
        styles=styles,
        provenance=facts_table("", flown | made_with),
        commands=f"""# from the folder that holds {adoption.name}/
flighttune adopt {tables["model"]} --V-a {adoption.V_a:.4g}
flighttune fly {adoption.name}/turn.toml
flighttune trim ./{adoption.name}
flighttune identify ./{adoption.name}""",
        texts={name: adoption.texts[name] for name in (AIRCRAFT, TURN)},
    )
    return page.path
