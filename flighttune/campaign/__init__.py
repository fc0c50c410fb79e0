"""Many flights of one scenario, dispersed: planned, flown, kept, and what they tell."""

from flighttune.campaign.load import load_campaign
from flighttune.campaign.make import plan_campaign
from flighttune.campaign.plan import Group, Plan, plan_from
from flighttune.campaign.schema import Campaign

__all__ = ["Campaign", "Group", "Plan", "load_campaign", "plan_campaign", "plan_from"]
