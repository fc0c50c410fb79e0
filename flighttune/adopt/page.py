"""One page on an adopted aircraft: whether it is adopted, how it flies, what was measured."""

from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np

from flighttune.adopt.adopt import CALM, GOOD_FIT, Adoption
from flighttune.adopt.files import TURN
from flighttune.aircraft.aircraft import load_aircraft
from flighttune.identify.experiment import DT
from flighttune.identify.model import lags_table
from flighttune.identify.steps import steps_table
from flighttune.present.chart import Chart
from flighttune.present.frame import Answer, Section, page_template, write_page
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.present.numbers import MISSING
from flighttune.present.palette import NEUTRAL, LineStyle, line_styles
from flighttune.present.tables import Table
from flighttune.scenario.tables import TUNED, TUNED_IDENTIFIED
from flighttune.simulate.run import Run
from flighttune.units import DEG

PAGE = "adoption.html"


def write_adoption(adoption: Adoption) -> Path:
    """Write the page of an aircraft into its folder, and return it.

    Parameters
    ----------
    found : Adoption
        With a folder.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    assert adoption.folder is not None
    assert adoption.turn is not None
    config = load_aircraft(adoption.folder)
    names = (
        "tuned on the identified aircraft",
        "the paper's, scaled with airspeed",
    )
    runs: dict[str, Run] = dict(zip(names, adoption.turn.runs, strict=True))
    # in the colours of these gains elsewhere, where those tuned on the law are the second of three
    pairs = [("", one) for one in ("paper", TUNED, TUNED_IDENTIFIED)]
    paper, _, identified = line_styles(pairs).values()
    styles: dict[str, LineStyle] = dict(zip(names, (identified, paper), strict=True))
    page = write_page(
        adoption.folder / PAGE,
        page_template("flighttune.adopt", "page.html.jinja"),
        summary=(
            f"{adoption.status.capitalize()}{adoption.reason and ': ' + adoption.reason}.",
            f"ITAE of the turn in rad s²: {', '.join(_itae(adoption))}.",
        ),
        answers=tuple(_answers(adoption)),
        sections=[_turn(runs, styles), _inner_loop(adoption), _trims(adoption)],
        title=f"{config.title} at {adoption.V_a:.0f} m/s",
        legend=list(styles.items()),
        styles=styles,
        notes=adoption.notes,
        provenance=Table(title="", head=(), rows=_provenance(adoption)),
        name=adoption.name,
        model=config.model,
        V_a=f"{adoption.V_a:.4g}",
        version=version("flighttune"),
        aircraft_text=config.file.read_text(encoding="utf-8"),
        turn_text=(adoption.folder / TURN).read_text(encoding="utf-8"),
    )
    return page.path


def _answers(adoption: Adoption) -> Iterator[Answer]:
    adopted = adoption.status == "adopted"
    yield Answer(
        question="Is it adopted?",
        verdict="yes" if adopted else "partly",
        short=adoption.status,
        sentences=(adoption.reason or "All criteria are met.",),
        criterion=f"Fits of at least {GOOD_FIT:g} %, the turn completed, the course error within "
        f"{CALM / DEG:g} deg (standard deviation of the last quarter), less ITAE than the paper's "
        "gains in both channels.",
    )
    fits = adoption.fit_percent
    yield Answer(
        question="Does a lag describe its inner loop?",
        verdict="yes" if min(fits.values()) >= GOOD_FIT else "no",
        short=" and ".join(f"{fit:.1f} %" for fit in fits.values()),
        sentences=("Of roll and of load factor, on a manoeuvre not used for the fit.",),
    )
    tuned, paper = adoption.flown["tuned"], adoption.flown["paper"]
    sentences = [
        f"{word}: {flight['status'].replace('_', ' ')}, "
        + ", ".join(
            f"ITAE of {channel} {flight[channel]['ITAE']:.3g} rad s²"
            for channel in ("chi", "gamma")
            if channel in flight
        )
        for word, flight in (("tuned", tuned), ("the paper's, scaled with airspeed", paper))
    ]
    better = tuned["status"] == "completed" and "ITAE" not in adoption.reason
    yield Answer(
        question="Are its gains better than the paper's?",
        verdict="yes" if better else "no",
        short="yes" if better else "no",
        sentences=tuple(sentences),
    )


def _itae(adoption: Adoption) -> Iterator[str]:
    tuned, paper = adoption.flown["tuned"], adoption.flown["paper"]
    for channel, symbol in CHANNEL_SYMBOLS.items():
        ours, theirs = (one[channel]["ITAE"] if channel in one else None for one in (tuned, paper))
        shown = (MISSING if one is None else f"{one:.3g}" for one in (ours, theirs))
        yield "{} {} (the paper's {})".format(symbol, *shown)


def _turn(runs: dict[str, Run], styles: dict[str, LineStyle]) -> Section:
    charts = []
    for title, y, signal, unit in (
        ("Course error", "e_χ [deg]", "chi_err", DEG),
        ("Path-angle error", "e_γ [deg]", "gamma_err", DEG),
        ("Roll", "φ [deg]", "phi", DEG),
        ("Load factor", "n_z [1]", "n_z", 1.0),
        ("Airspeed", "V_a [m/s]", "V_a", 1.0),
        ("Throttle", "throttle [1]", "throttle", 1.0),
    ):
        chart = Chart(title=title, y=y, linked=True)
        if signal.endswith("_err"):
            chart.level(0.0, NEUTRAL, dash="")
        for name, run in runs.items():
            if len(run.signals):
                values = run.signals[signal].to_numpy() / unit
                chart.run_line(run.t, values, styles[name], name)
        charts.append(chart)
    return Section(
        id="turn",
        title="The turn: course of 20 deg, climb of 3 deg",
        charts=charts,
        columns=3,
        folded=False,
    )


def _inner_loop(adoption: Adoption) -> Section:
    assert adoption.designed is not None
    assert adoption.identified is not None
    return Section(
        id="inner_loop",
        title="The inner loop",
        note="Steps flown against what was asked for, and the manoeuvre that checks the fit.",
        charts=list(_check_charts(adoption)),
        tables=(steps_table(adoption.designed.checks), lags_table(adoption.identified.identified)),
        legend=False,
    )


def _check_charts(adoption: Adoption) -> Iterator[Chart]:
    assert adoption.identified is not None
    one = adoption.identified.conditions[0]
    t = np.arange(len(one.check.measured)) * DT
    for i, (title, y, unit) in enumerate((("Roll", "φ [deg]", DEG), ("Load factor", "n_z", 1.0))):
        chart = Chart(title=title, y=y)
        styles = line_styles([("", "flown"), ("", "lag")]).values()
        columns = one.check.measured[:, i], one.check_model[:, i]
        for name, style, values in zip(("flown", "lag"), styles, columns, strict=True):
            chart.line(t, values / unit, style.colour, name=name)
        yield chart


def _trims(adoption: Adoption) -> Section:
    rows = [
        (
            f"{row.condition.V_a:.1f}",
            f"{row.condition.gamma / DEG:.0f}",
            *(
                (f"{row.point.alpha / DEG:.1f}", f"{row.point.throttle:.2f}")
                if row.point
                else ("-", "-")
            ),
            row.reason,
        )
        for row in adoption.trims
    ]
    return Section(
        id="trims",
        title="Where it flies",
        note="Steady flight about the airspeed chosen.",
        tables=(
            Table(
                title="Trims",
                head=("V_a [m/s]", "γ [deg]", "α [deg]", "throttle", "no trim"),
                rows=rows,
                last_is_text=True,
            ),
        ),
        legend=False,
    )


def _provenance(adoption: Adoption) -> list[tuple[str, str]]:
    return [
        ("aircraft", adoption.name),
        ("airspeed", f"{adoption.V_a:.4g} m/s"),
        ("engines", str(adoption.engines)),
        ("flighttune", version("flighttune")),
        ("JSBSim", version("jsbsim")),
    ]
