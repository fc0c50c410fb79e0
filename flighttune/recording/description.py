"""Everything about a run but its signals, as plain values: what Parquet and recordings keep."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from flighttune.control.gains import PIGains
from flighttune.simulate.run import Provenance, Run

FORMAT = 1
"""Version of the layout; a file with a higher one is from a newer flighttune."""


def description(run: Run) -> dict[str, Any]:
    """Status and provenance of a run, ready for JSON where the scenario is."""
    made = run.provenance
    gains = made.gains
    return {
        "format": FORMAT,
        "status": run.status,
        "reason": run.reason,
        "provenance": {
            "scenario": _plain(made.scenario),
            "plant": made.plant,
            "gains_name": made.gains_name,
            "gains": None
            if gains is None
            else {
                "K_P": gains.K_P.tolist(),
                "K_I": gains.K_I.tolist(),
                "inputs": list(gains.inputs),
                "errors": list(gains.errors),
            },
            "seed": made.seed,
            "versions": dict(made.versions),
            "wall_s": made.wall_s,
        },
    }


def described_run(found: Mapping[str, Any], signals: pd.DataFrame) -> Run:
    """The run that `description` described, with its signals.

    Raises
    ------
    KeyError, TypeError, ValueError, AttributeError
        If `found` is not such a description.
    """
    made = dict(found["provenance"])
    if made["gains"] is not None:
        gains = dict(made["gains"])
        for names in ("inputs", "errors"):
            gains[names] = tuple(gains[names])
        made["gains"] = PIGains(**gains)
    return Run(
        signals=signals,
        status=found["status"],
        reason=found["reason"],
        provenance=Provenance(**made),
    )


def signal_table(t: np.ndarray, columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Signals as a run holds them: float64 columns over `t` in s."""
    index = pd.Index(t, name="t", dtype=np.float64)
    return pd.DataFrame(dict(columns), index=index, dtype=np.float64)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return value
