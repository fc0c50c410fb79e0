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


def write_adoption(found: Adoption) -> Path:
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
    assert found.folder is not None
    assert found.turn is not None
    config = load_aircraft(found.folder)
    names = (
        "tuned on the identified aircraft",
        "the paper's, scaled with airspeed",
    )
    runs: dict[str, Run] = dict(zip(names, found.turn.runs, strict=True))
    # in the colours of these gains elsewhere, where those tuned on the law are the second of three
    pairs = [("", one) for one in ("paper", TUNED, TUNED_IDENTIFIED)]
    paper, _, identified = line_styles(pairs).values()
    styles: dict[str, LineStyle] = dict(zip(names, (identified, paper), strict=True))
    page = write_page(
        found.folder / PAGE,
        page_template("flighttune.adopt", "page.html.jinja"),
        summary=(
            f"{found.status.capitalize()}{found.reason and ': ' + found.reason}.",
            f"ITAE of the turn in rad s²: {', '.join(_itae(found))}.",
        ),
        answers=tuple(_answers(found)),
        sections=[_turn(runs, styles), _inner_loop(found), _trims(found)],
        title=f"{config.title} at {found.V_a:.0f} m/s",
        legend=list(styles.items()),
        styles=styles,
        notes=found.notes,
        provenance=Table(title="", head=(), rows=_provenance(found)),
        name=found.name,
        model=config.model,
        V_a=f"{found.V_a:.4g}",
        version=version("flighttune"),
        aircraft_text=config.file.read_text(encoding="utf-8"),
        turn_text=(found.folder / TURN).read_text(encoding="utf-8"),
    )
    return page.path


def _answers(found: Adoption) -> Iterator[Answer]:
    adopted = found.status == "adopted"
    yield Answer(
        question="Is it adopted?",
        verdict="yes" if adopted else "partly",
        short=found.status,
        sentences=(found.reason or "All criteria are met.",),
        criterion=f"Fits of at least {GOOD_FIT:g} %, the turn completed, the course error within "
        f"{CALM / DEG:g} deg (standard deviation of the last quarter), less ITAE than the paper's "
        "gains in both channels.",
    )
    fits = found.fit_percent
    yield Answer(
        question="Does a lag describe its inner loop?",
        verdict="yes" if min(fits.values()) >= GOOD_FIT else "no",
        short=" and ".join(f"{fit:.1f} %" for fit in fits.values()),
        sentences=("Of roll and of load factor, on a manoeuvre not used for the fit.",),
    )
    tuned, paper = found.flown["tuned"], found.flown["paper"]
    sentences = [
        f"{word}: {flight['status'].replace('_', ' ')}, "
        + ", ".join(
            f"ITAE of {channel} {flight[channel]['ITAE']:.3g} rad s²"
            for channel in ("chi", "gamma")
            if channel in flight
        )
        for word, flight in (("tuned", tuned), ("the paper's, scaled with airspeed", paper))
    ]
    better = tuned["status"] == "completed" and "ITAE" not in found.reason
    yield Answer(
        question="Are its gains better than the paper's?",
        verdict="yes" if better else "no",
        short="yes" if better else "no",
        sentences=tuple(sentences),
    )


def _itae(found: Adoption) -> Iterator[str]:
    tuned, paper = found.flown["tuned"], found.flown["paper"]
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


def _inner_loop(found: Adoption) -> Section:
    assert found.designed is not None
    assert found.identified is not None
    return Section(
        id="inner_loop",
        title="The inner loop",
        note="Steps flown against what was asked for, and the manoeuvre that checks the fit.",
        charts=list(_check_charts(found)),
        tables=(steps_table(found.designed.checks), lags_table(found.identified.identified)),
        legend=False,
    )


def _check_charts(found: Adoption) -> Iterator[Chart]:
    assert found.identified is not None
    one = found.identified.conditions[0]
    t = np.arange(len(one.check.measured)) * DT
    for i, (title, y, unit) in enumerate((("Roll", "φ [deg]", DEG), ("Load factor", "n_z", 1.0))):
        chart = Chart(title=title, y=y)
        styles = line_styles([("", "flown"), ("", "lag")]).values()
        columns = one.check.measured[:, i], one.check_model[:, i]
        for name, style, values in zip(("flown", "lag"), styles, columns, strict=True):
            chart.line(t, values / unit, style.colour, name=name)
        yield chart


def _trims(found: Adoption) -> Section:
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
        for row in found.trims
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


def _provenance(found: Adoption) -> list[tuple[str, str]]:
    return [
        ("aircraft", found.name),
        ("airspeed", f"{found.V_a:.4g} m/s"),
        ("engines", str(found.engines)),
        ("flighttune", version("flighttune")),
        ("JSBSim", version("jsbsim")),
    ]
