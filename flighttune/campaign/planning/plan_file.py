"""Plans as plain values, and back to the bit; what two plans differ in."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from flighttune.campaign.planning.schema import Campaign, CampaignTable
from flighttune.control.gains import PIGains
from flighttune.errors import ScenarioError
from flighttune.scenario.load import validated
from flighttune.scenario.schema import GainsTable, Scenario

if TYPE_CHECKING:
    from flighttune.campaign.planning.plan import Plan

VERSION = 1
"""Of the form of the values; another is refused."""

FOR_THE_READER = frozenset({"title", "verifies", "source"})
"""Keys that change no row."""

UNTOLD = object()


def plan_tables(plan: "Plan") -> dict[str, Any]:
    """A plan as plain values that JSON has words for."""
    campaign = plan.campaign
    return _spelled(
        {
            "version": VERSION,
            "runs": plan.runs,
            "groups": [{"plant": group.plant, "gains": group.gains} for group in plan.groups],
            "gains": {
                name: None if g is None else {"K_P": g.K_P.tolist(), "K_I": g.K_I.tolist()}
                for name, g in plan.gain_sets.items()
            },
            "aircraft": dict(plan.aircraft),
            "campaign": campaign.as_dict(),
            "nominal": _plain(campaign.nominal),
            "central": _plain(campaign.central),
        }
    )


def plan_fields(tables: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The attributes of the plan that `plan_tables` wrote; groups as tables.

    Parameters
    ----------
    tables : mapping
        As JSON gives them back.
    source : str
        The file they come from, or what else to call them.

    Raises
    ------
    ScenarioError
        If they are not a plan, or one of another version of the form.
    """
    values = _read(dict(tables))
    if values.get("version") != VERSION:
        raise ScenarioError(
            f"{source}: `version` of a plan must be {VERSION}, got {values.get('version')!r}."
        )
    try:
        return {
            "campaign": Campaign.of(
                validated(CampaignTable, values["campaign"], source),
                nominal=validated(Scenario, values["nominal"], source),
                central=validated(Scenario, values["central"], source),
            ),
            "gain_sets": {
                name: None if given is None else _gains({"name": name, **given}, source)
                for name, given in values["gains"].items()
            },
            "groups": tuple(values["groups"]),
            "runs": values["runs"],
            "aircraft": values["aircraft"],
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise ScenarioError(f"{source}: must be a plan, got one that lacks {error}.") from None


def plan_differences(plan: "Plan", other: "Plan") -> tuple[str, ...]:
    """What of `plan` is otherwise in `other`, ``key: was X, is Y`` each; see `Plan.differences`."""
    was, now = _leaves_of(plan), _leaves_of(other)
    return tuple(
        f"{key}: was {_said(was.get(key, UNTOLD))}, is {_said(now.get(key, UNTOLD))}"
        for key in dict.fromkeys([*was, *now])
        if _bits(was.get(key, UNTOLD)) != _bits(now.get(key, UNTOLD))
    )


def _plain(scenario: Scenario) -> dict[str, Any]:
    return scenario.model_dump(mode="python", exclude_none=True)


def _gains(tables: dict[str, Any], source: str) -> PIGains:
    return validated(GainsTable, tables, f"{source}: gains").gains()


def _leaves_of(plan: "Plan") -> dict[str, Any]:
    tables = _read(plan_tables(plan))
    campaign = tables["campaign"]
    told = {key: value for key, value in campaign.items() if key not in FOR_THE_READER}
    told.pop("runs", None)
    told["disperse"] = {table["key"]: table for table in campaign["disperse"]}
    scenario = {k: v for k, v in tables["nominal"].items() if k not in FOR_THE_READER}
    return {
        "runs": tables["runs"],
        **dict(_walk(told, "")),
        **dict(_walk(scenario, "scenario.")),
        **dict(_walk(tables["gains"], "gains as numbers, ")),
        **dict(_walk(tables["aircraft"], "files of aircraft ")),
    }


def _walk(value: Any, above: str) -> Iterator[tuple[str, Any]]:
    """Names and values of everything that is neither a table nor an array of tables."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _walk(item, f"{above}{name}.")
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for i, item in enumerate(value):
            yield from _walk(item, f"{above.removesuffix('.')}[{i}].")
    else:
        yield above.removesuffix("."), value


def _bits(value: Any) -> str:
    return "nothing" if value is UNTOLD else repr(value)


def _said(value: Any) -> str:
    text = "not given" if value is UNTOLD else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _spelled(value: Any) -> Any:
    """Values with numbers that JSON has no word for written as ``{"float": "nan"}``."""
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": repr(value)}
    if isinstance(value, Mapping):
        return {key: _spelled(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_spelled(item) for item in value]
    return value


def _read(value: Any) -> Any:
    """The values that `_spelled` wrote."""
    if isinstance(value, Mapping):
        if set(value) == {"float"} and isinstance(value["float"], str):
            return float(value["float"])
        return {key: _read(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_read(item) for item in value]
    return value
