"""Steady flights of an aircraft over its envelope, as a result that is shown."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from flighttune.base.answering import Answering
from flighttune.base.answers.answer import Answer, Table
from flighttune.base.answers.labels import columns
from flighttune.base.units import Metres, MetresPerSecond, Radians
from flighttune.base.words import figures
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.plants.jsbsim.trim import trim_table

COLUMNS = columns(
    "V_a_mps gamma_deg trim.alpha_deg trim.beta_deg trim.elevator_deg trim.rudder_deg "
    "trim.throttle reason"
)
SPEED_COLUMNS = columns("V_a_mps gamma throttle reason", of="trims")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trims(Answering):
    """Steady flights of an aircraft, and why there is none at some conditions.

    Attributes
    ----------
    aircraft : str
        Its name or folder.
    title : str
        Its title.
    records : sequence of mapping
        A record a condition: ``V_a_mps``, ``gamma_deg``, ``phi_deg``, ``h_m``, ``trim`` (angles of
        attack, sideslip, pitch and of the surfaces in deg, throttle 0 to 1; None if there is no
        steady flight) and ``reason``, what stands against it.

    Examples
    --------
    >>> trims = ft.trim("aerosonde", V_a=[25.0], gamma=[0.0])
    >>> 0.1 < trims.records[0]["trim"]["throttle"] < 0.5
    True
    """

    aircraft: str
    title: str
    records: Sequence[Mapping[str, Any]]

    def answer(self, *, every_condition: bool = False) -> Answer:
        """A row for each airspeed, or for every condition."""
        records, columns = self.records, COLUMNS
        # With one path angle for each airspeed the table of all conditions is as short.
        if not every_condition and len({row["V_a_mps"] for row in records}) < len(records):
            records, columns = list(_speeds(records)), SPEED_COLUMNS
        reason = self.records[0]["reason"]
        failure = f"{self.aircraft}: no steady flight among {len(self.records)}: {reason}"
        return Answer(
            values={"aircraft": self.aircraft, "trims": self.records},
            tables=[Table(columns, records, f"{self.title}: steady flight")],
            failure="" if any(row["trim"] for row in self.records) else failure,
        )


def trim(
    aircraft: str | Path,
    *,
    V_a: Sequence[MetresPerSecond] | None = None,
    gamma: Sequence[Radians] | None = None,
    phi: Radians = 0.0,
    h: Metres = 1000.0,
) -> Trims:
    """Trim an aircraft at every airspeed with every flight-path angle.

    Parameters
    ----------
    aircraft : str or Path
        A shipped aircraft, or the folder of one.
    V_a : sequence of float, m/s, optional
        Airspeeds, by default six over the envelope.
    gamma : sequence of float, rad, optional
        Flight-path angles, climb positive, by default -10 to 45 deg, or the glide of an aircraft
        without an engine.
    phi : float, rad
        Bank, right wing down positive.
    h : float, m
        Height above sea level.

    Returns
    -------
    Trims

    Raises
    ------
    InputError
        If there is no such aircraft, or an airspeed or angle is no number for a flight.
    PlantError
        If the aircraft cannot be built.

    Examples
    --------
    >>> ft.trim("a4", V_a=[50.0], gamma=[0.0]).records[0]["trim"] is None
    True
    """
    config = load_aircraft(aircraft)
    records = trim_table(config, V_a=V_a, gamma=gamma, phi=phi, h=h)
    return Trims(aircraft=str(aircraft), title=config.title, records=records)


def _speeds(records: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """A row for each airspeed: where flight is steady, and why not at the other path angles."""
    for V_a, group in groupby(records, key=lambda record: record["V_a_mps"]):
        climbs = sorted(group, key=lambda record: record["gamma_deg"])
        steady = [record for record in climbs if record["trim"]]
        reasons = [
            f"{_range(record['gamma_deg'] for record in alike)}: {reason}"
            for reason, alike in groupby(climbs, key=lambda record: record["reason"])
            if reason
        ]
        yield {
            "V_a_mps": V_a,
            "gamma": _range(record["gamma_deg"] for record in steady),
            "throttle": _range(record["trim"]["throttle"] for record in steady),
            "reason": "; ".join(reasons),
        }


def _range(values: Iterable[float]) -> str:
    """``-5 to 10``, or the only value; empty without values."""
    ordered = sorted(values)
    return " to ".join(dict.fromkeys(figures(value) for value in (*ordered[:1], *ordered[-1:])))
