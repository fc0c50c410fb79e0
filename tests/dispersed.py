"""Plans of short flights, from a scenario's tables and what is dispersed, and their rows."""

from pathlib import Path
from tempfile import TemporaryDirectory

import tomlkit

import flighttune as ft

SOFT = {"name": "soft", "K_P": [[0.8, 0.1], [-0.1, 0.9]], "K_I": [[0.4, 0.0], [0.0, 0.4]]}
KINEMATIC = {"kind": "kinematic"}
AEROSONDE = {"kind": "jsbsim", "aircraft": "aerosonde"}
WIND = {"speed_mps": 6.0, "from_deg": 250.0}
TURBULENCE = {"severity": 4, "wind_20ft_mps": 15.4}
NOTHING_KEPT = {"failures": 0, "worst": 0, "sample": 0}


def tables_of(plants=(KINEMATIC,), **tables):
    """A turn and climb of three seconds, as the tables of a scenario."""
    return {
        "title": "A short turn and climb",
        "gains": ["paper", SOFT],
        "flight": {"V_a_mps": 25.0, "chi_deg": 20.0, "gamma_deg": 10.0, "duration_s": 3.0},
        "reference": {"chi_deg": 0.0, "gamma_deg": 0.0},
        "limits": {
            "phi_deg": [-42.0, 47.0], "phi_rate_dps": [-55.0, 65.0],
            "n_z": [-1.8, 2.1], "n_z_rate_per_s": [-1.9, 2.2],
        },
        "controller": {"feed_forward": True},
        "plant": list(plants),
        **tables,
    }  # fmt: skip


def campaign_of(nominal, *disperse, **keys):
    """A campaign on a scenario, with its gains where `keys` have none."""
    given = {"title": "t", "scenario": "s", "runs": 24, "keep": NOTHING_KEPT}
    with TemporaryDirectory() as folder:
        file = Path(folder, "campaign.toml")
        file.write_text(tomlkit.dumps({**given, **keys, "disperse": list(disperse)}), "utf-8")
        return ft.load_campaign(file, nominal)


def plan_of(tables, *disperse, seed=1, **keys):
    """The plan of a campaign on a scenario's tables."""
    return ft.plan_campaign(campaign_of(ft.scenario_from(tables), *disperse, seed=seed, **keys))


def rows_of(plan):
    """Rows of all runs of a plan as a table, without the time that flights took."""
    with TemporaryDirectory() as folder:
        ft.run_campaign(plan, f"{folder}/out", workers=1)
        return ft.load(f"{folder}/out").rows().drop_columns(["wall_s"])


def uniform(key, lower, upper, **keys):
    """A key drawn between two values."""
    return {"key": key, "distribution": "uniform", "lower": lower, "upper": upper, **keys}


def one_of(key, *values, **keys):
    """A key that is one of some values."""
    return {"key": key, "distribution": "choice", "values": list(values), **keys}
