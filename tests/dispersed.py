"""Plans of short flights for tests, without files: a scenario's tables and what is dispersed."""

import flighttune as ft
from flighttune.campaigns.planning.schema import CampaignTable

SOFT = {"name": "soft", "K_P": [[0.8, 0.1], [-0.1, 0.9]], "K_I": [[0.4, 0.0], [0.0, 0.4]]}
KINEMATIC = {"kind": "kinematic"}
AEROSONDE = {"kind": "jsbsim", "aircraft": "aerosonde"}
WIND = {"speed_mps": 6.0, "from_deg": 250.0}
TURBULENCE = {"severity": 4, "wind_20ft_mps": 15.4}


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
    given = {"title": "t", "scenario": "s", "runs": 24, **keys, "disperse": list(disperse)}
    table = CampaignTable.model_validate(given)
    if table.gains is not None:
        nominal = nominal.model_copy(update={"gains": table.gains})
    return ft.Campaign.of(table, nominal=nominal, central=nominal)


def plan_of(tables, *disperse, seed=1, **keys):
    """The plan of a campaign on a scenario's tables."""
    return ft.plan_campaign(campaign_of(ft.scenario_from(tables), *disperse, seed=seed, **keys))


def uniform(key, lower, upper):
    """A key drawn between two values."""
    return {"key": key, "distribution": "uniform", "lower": lower, "upper": upper}


def one_of(key, *values):
    """A key that is one of some values."""
    return {"key": key, "distribution": "choice", "values": list(values)}
