"""Columns of a campaign's rows: names, types and units, fixed by the plan alone."""

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import pyarrow as pa

from flighttune.base.names import UNIT_OF_SUFFIX
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.schema import MEASURES, Choice, Dispersion, Grid
from flighttune.flight.metrics import AIRSPEED, AIRSPEED_METRICS, ENVELOPES, required_names, unit_of

# Unit of a key of a scenario by its ending, longest ending first
UNITS_OF_ENDINGS = UNIT_OF_SUFFIX | {
    "_mps2": "m/s^2",
    "_rad": "rad",
    "_dps": "deg/s",
    "_hz": "1/s",
    "_amplitude": "rad/s",
}

# Columns of one run, as in `row_schema`; a missing column is null. A row of an aircraft has its
# `CompiledFlights` too, which are no column of a table.
Row = dict[str, Any]

# Columns that differ between flights of the same run.
NOT_REPRODUCIBLE = ("wall_s",)

# Columns before the dispersed keys
BEFORE = {
    "run": pa.int64(),
    "draw": pa.int64(),
    "plant": pa.string(),
    "gains": pa.string(),
    "seed": pa.int64(),
}

# Columns after the dispersed keys, before the measures
OUTCOME = {
    "status": pa.string(),
    "reason": pa.string(),
    "success": pa.bool_(),
    "missed": pa.string(),
}

# Columns after the measures: type and unit
AFTER = {
    "R_K": (pa.float64(), "1/s"),
    "I_K": (pa.float64(), "s^2"),
    "E_K": (pa.float64(), "s^2"),
    "wall_s": (pa.float64(), "s"),
}


def table_of(plan: Plan, rows: Iterable[Row]) -> pa.Table:
    """Rows of a plan as a table, in order of `run`, without the results of probes."""
    return pa.Table.from_pylist(sorted(rows, key=lambda row: row["run"]), schema=row_schema(plan))


@lru_cache(maxsize=32)  # making it takes as long as the compiled flight of a row
def row_schema(plan: Plan) -> pa.Schema:
    """The schema of the rows of a plan; a field has its ``unit`` as metadata."""
    required = required_names([table.model_dump() for table in plan.scenario.expect])
    more = [f"{channel}.{name}" for channel, names in required.items() for name in names]
    if plan.scenario.airspeed:
        more += [f"{AIRSPEED}.{name}" for name in AIRSPEED_METRICS]
    return pa.schema(
        [
            *(pa.field(name, kind, nullable=False) for name, kind in BEFORE.items()),
            *(_of_key(table) for table in plan.campaign.disperse),
            *(pa.field(name, kind, nullable=False) for name, kind in OUTCOME.items()),
            *(
                _field(name, pa.float64(), unit_of(*name.split(".", 1)))
                for name in [*MEASURES, *more]
            ),
            *(_field(name, kind, unit) for name, (kind, unit) in AFTER.items()),
        ]
    )


def unit_of_key(key: str) -> str:
    """Unit of a key of a scenario, from its ending."""
    name = key.split(".")[-1].split("[")[0]
    return next((unit for end, unit in UNITS_OF_ENDINGS.items() if name.endswith(end)), "1")


def _of_key(table: Dispersion) -> pa.Field:
    values = table.values if isinstance(table, (Choice, Grid)) else None
    if (kind := pa.array(values or [0.0]).type) in (pa.string(), pa.bool_()):
        return _field(table.key, kind, None)
    return _field(table.key, kind, "1" if table.acts == "multiplies" else unit_of_key(table.key))


def _field(name: str, kind: pa.DataType, unit: str | None) -> pa.Field:
    return pa.field(name, kind, metadata=None if unit is None else {"unit": unit})


def measured_in(row: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """The measures of a row by subject, as `flighttune.flight.metrics.measures` returns them."""
    measured: dict[str, dict[str, float]] = {}
    # Additional settling times and envelopes of the scenario, and the airspeed if it is a channel.
    more = (column for column in row if column.split(".")[0] in ENVELOPES)
    for column in dict.fromkeys((*MEASURES, *more)):
        subject, name = column.split(".", 1)
        value = row.get(column)
        measured.setdefault(subject, {})[name] = math.nan if value is None else value
    return measured
