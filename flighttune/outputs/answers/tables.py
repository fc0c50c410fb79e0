"""Tables that several answers show."""

import math
from collections.abc import Sequence

from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import pick
from flighttune.claims.distribution import DRAWN, Distribution
from flighttune.control.gains import ERRORS, PIGains
from flighttune.control.margins import Margins
from flighttune.outputs.answers.answer import Column, Table
from flighttune.outputs.answers.labels import columns
from flighttune.vehicles.identification.file import IdentifiedAircraft

LAG_COLUMNS = columns(
    "V_a_mps gamma_deg channel order natural_frequency_rad_s damping lag_s delay_s bandwidth_rad_s "
    "cross fit_percent"
)

MARGIN_COLUMNS = columns(
    "loop gain_decrease gain_increase phase_margin_deg delay_margin_s lag_margin_s", of="margins"
)


def margins_table(margins: Sequence[Margins]) -> Table:
    """Stability margins: a row for each channel, and a row for all channels together."""
    records = [
        {
            **pick(row, "loop gain_decrease gain_increase"),
            "phase_margin_deg": math.degrees(row.phase_margin),
            "delay_margin_s": row.delay_margin,
        }
        for row in margins
    ]
    if margins:  # the last row is for all channels together
        last = margins[-1]
        records[-1] |= {"lag_margin_s": last.lag_margin, "disk_margin": last.disk_margin}
    return Table(MARGIN_COLUMNS, records, "stability margins", name="margins")


def lags_table(aircraft: IdentifiedAircraft) -> Table:
    """Every lag with its fit, a row for each channel of a condition."""
    records, assumed = [], aircraft.log.assumed if aircraft.log else ()
    for point in aircraft.conditions:
        place = {"V_a_mps": point.V_a, "gamma_deg": point.gamma * DEG_PER_RAD}
        for name, channel in point.channels.items():
            record = {**place, "channel": name, **channel.model_dump(exclude={"simpler"})}
            # no flight was fitted for an assumed lag
            records.append(record | ({"fit_percent": None} if name in assumed else {}))
    title = f"{aircraft.aircraft}: identified inner loop"
    return Table(title=title, columns=LAG_COLUMNS, records=records)


def dispersions_table(distribution: Distribution, flown: str) -> Table:
    """Plant, airspeed, start, air, and every drawn key with its range and unit."""
    records = distribution.records(flown)
    return Table(columns(" ".join(DRAWN)), records, "flights", name="dispersions")


def gains_table(title: str, gains: PIGains | None) -> Table:
    """Gains as a table with a row for each command; empty without gains."""
    columns = [Column("command", "command")]
    for part, of in (("P", "e_"), ("I", "int e_")):
        errors = enumerate(ERRORS if gains is None else gains.errors)
        columns += [Column(f"{part}.{i}", f"{of}{name}", digits="z.4f") for i, name in errors]
    if gains is None:
        return Table(columns, [], title)
    rows = zip(gains.labels, gains.K_P.tolist(), gains.K_I.tolist(), strict=True)
    records = [{"command": name, "P": K_P, "I": K_I} for name, K_P, K_I in rows]
    if gains.feeds_back:
        columns.append(Column("feedback", "feedback", digits="z.4f", missing=""))
        for record, fed in zip(records, gains.feedback, strict=False):
            record["feedback"] = fed
    return Table(columns, records, title)
