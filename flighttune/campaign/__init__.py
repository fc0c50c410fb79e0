"""Many flights of one scenario, dispersed: planned, flown, stored and evaluated.

Everything is imported on first use: workers import this package, and fly in other processes.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flighttune.campaign.engine.engine import run_campaign
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.campaign.planning.plan import Group, Plan, plan_campaign, plan_from
    from flighttune.campaign.planning.schema import Campaign

__all__ = [
    "Campaign",
    "Group",
    "Plan",
    "load_campaign",
    "plan_campaign",
    "plan_from",
    "run_campaign",
]

_HOMES = {
    "load_campaign": "planning.load",
    "plan_campaign": "planning.plan",
    "Group": "planning.plan",
    "Plan": "planning.plan",
    "plan_from": "planning.plan",
    "Campaign": "planning.schema",
    "run_campaign": "engine.engine",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
