"""Scenarios and runs that tests make up, or shorten."""

import pandas as pd

import flighttune as ft
from flighttune.base.files.table import toml_text
from flighttune.flight.loop.run import Provenance
from flighttune.flight.records.parquet import parquet_bytes


def scenario_tables(**changes):
    """Level flight straight on, as the tables of a scenario; those given are merged into them."""
    tables = {
        "title": "Straight on",
        "gains": ["paper"],
        "flight": {"V_a_mps": 25.0},
        "reference": {"chi_deg": 0.0, "gamma_deg": 0.0},
        "plant": [{"kind": "kinematic"}],
    }
    for key, value in changes.items():
        tables[key] = {**tables.get(key, {}), **value} if isinstance(value, dict) else value
    return tables


def made_up_scenario(**changes):
    """The scenario of these tables."""
    return ft.scenario_from(scenario_tables(**changes))


def shortened(name, seconds, **changes):
    """A shipped scenario of so many seconds, which expects nothing."""
    tables = {**ft.load_scenario(name).as_dict(), "expect": [], **changes}
    return ft.scenario_from(tables | {"flight": {**tables["flight"], "duration_s": seconds}})


def scenario_file(path, scenario, **changes):
    """Write a scenario, with other tables in it, to a file."""
    path.write_text(toml_text(scenario.as_dict() | changes), encoding="utf-8")
    return path


def made_up_run(
    columns, t=None, *, plant="kinematic", gains_name="paper", gains=ft.PAPER_GAINS, scenario=None,
    status="completed", reason="", versions=None,
):  # fmt: skip
    """A run of these signals, over these times or those that are their index."""
    index = None if t is None else pd.Index(t, name="t")
    return ft.Run(
        signals=pd.DataFrame(columns, index=index, dtype=float),
        status=status,
        reason=reason,
        provenance=Provenance(
            scenario=scenario or {},
            plant=plant,
            gains_name=gains_name,
            gains=gains,
            seed=7,
            versions=versions or {},
            wall_s=0.1 + 0.2,
        ),
    )


def run_file(path, run):
    """Write the Parquet file of a run; its path."""
    path.write_bytes(parquet_bytes(run))
    return path


def run_folder(folder, *runs):
    """Write a folder with the Parquet files of some runs; its path."""
    folder.mkdir()
    for number, run in enumerate(runs):
        run_file(folder / f"{number}.parquet", run)
    return folder
