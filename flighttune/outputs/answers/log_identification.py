"""The answer of the identification from logs, and its figure."""

from flighttune.base.words import pick
from flighttune.logs.identify import NAMES, SHOWN_S, UNITS, LogIdentification
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns as columns_by
from flighttune.outputs.answers.tables import lags_table
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, NEUTRAL
from flighttune.vehicles.identification.file import identified_tables

CHANNEL_COLUMNS = columns_by(
    "channel order natural_frequency frequency_interval delay delay_interval fit_percent stretches",
    of="responses",
)


def answer(found: LogIdentification) -> Answer:
    """Lags with intervals; a failure if a channel has no lag."""
    records = [
        {
            "channel": name,
            **pick(channel.lag, "order natural_frequency delay"),
            "frequency_interval": ends("{:.2f} to {:.2f}", channel.frequency),
            "delay_interval": ends("{:.3f} to {:.3f}", channel.delay),
            **pick(channel, "fit_percent stretches"),
            "by_log_percent": channel.by_log,
        }
        for name, channel in found.channels.items()
    ]
    tables = [Table(CHANNEL_COLUMNS, records, f"{found.title}: responses", name="responses")]
    untold = dict(found.untold)
    if found.identified is None:
        return Answer(values={"untold": untold}, tables=tables, findings=unmet(found.missing))
    return Answer(
        values={**identified_tables(found.identified), "untold": untold},
        tables=[*tables, lags_table(found.identified)],
        notes=[*notes(found), *found.identified.assumptions],
    )


def notes(found: LogIdentification) -> list[str]:
    """Unidentifiable channels, agreement of the logs, and residuals of the lags."""
    told = [f"{name}: {reason}" for name, reason in found.untold.items()]
    told += [
        f"{name} of each log by the lag of the others: "
        f"{', '.join(f'{share:.1f}' for share in channel.by_log)} %"
        for name, channel in found.channels.items()
        if channel.by_log
    ]
    told += [
        f"{name} has no interval: {channel.reason}"
        for name, channel in found.channels.items()
        if channel.reason
    ]
    evidence = found.identified and found.identified.log
    if evidence and evidence.residual_rad_s:
        rates = " and ".join(
            f"{value:.3g} rad/s of {name}" for name, value in evidence.residual_rad_s.items()
        )
        told.append(f"residual rates up to {rates}: {evidence.sentence}")
    return told


def sheet(found: LogIdentification) -> Sheet:
    """The first seconds of each channel: commanded, measured and the fit."""
    charts = []
    for name, channel in found.channels.items():
        section = max(channel.sections, key=lambda section: len(section.t))
        shown = section.t - section.t[0] <= SHOWN_S
        title = f"{NAMES[name]}: {channel.fit_percent:.1f} % of the variance held out"
        chart = Chart(title=title, y=f"{name} [{'deg' if name == 'phi' else '1'}]")
        fitted = section.measured + section.residual(channel.lag)
        for label, values, colour, dash in (
            ("commanded", section.commanded, NEUTRAL, DASHED),
            ("measured", section.measured, HUES[0][0][0], ""),
            (f"lag of order {channel.lag.order}", fitted, HUES[1][0][0], ""),
        ):
            t, shape = section.t[shown] - section.t[0], values[shown] / UNITS[name]
            chart.line(t, shape, colour, dash=dash, name=label)
        charts.append(chart)
    return Sheet(charts=charts, title=found.title)


def ends(form: str, interval: tuple[float, float] | None) -> str:
    """An interval in words; empty without one."""
    return form.format(*interval) if interval else ""
