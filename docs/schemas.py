"""Write the JSON schemas that editors read of our files: python docs/schemas.py."""

import json
from typing import Any

from site_reference import _models, meanings

from flighttune.base.files.shipped import SCHEMAS
from flighttune.base.quantities import Table
from flighttune.campaigns.planning.schema import CampaignTable
from flighttune.claims.rates_keys import RatesTable
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.aircraft.aircraft import AircraftConfig

MODELS: dict[str, type[Table]] = {
    "scenario": Scenario,
    "campaign": CampaignTable,
    "aircraft": AircraftConfig,
    "rates": RatesTable,
}


def schema_of(model: type[Table]) -> dict[str, Any]:
    """The schema of a file, its keys explained by the comments of the model."""
    schema = model.model_json_schema(by_alias=True)
    models: dict[str, type[Table]] = {}
    _models(model, models)
    for name, table in [(model.__name__, schema), *schema.get("$defs", {}).items()]:
        for key, text in (meanings(models[name]) if name in models else {}).items():
            if text and key in table.get("properties", {}):
                table["properties"][key]["description"] = text
    if model is Scenario:
        _as_in_files(schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _as_in_files(schema: dict[str, Any]) -> None:
    """Add what a file may have in place of the tables that the reader makes of it."""
    law = {"anyOf": [{"type": "string"}, {"$ref": "#/$defs/LawTable"}]}
    keys = schema["properties"]
    keys["law"]["anyOf"] = [*law["anyOf"], {"type": "array", "items": law, "minItems": 1}]
    # A route in a file of its own has no waypoints here.
    route = schema["$defs"]["RouteTable"]
    own = {name: value for name, value in route["properties"].items() if name != "waypoint"}
    own["file"] = {"type": "string", "description": "File with the route, beside the scenario."}
    own["skip"] = {"type": "boolean", "description": "Leave out the items that nothing flies."}
    of_file = {**route, "title": "RouteOfFile", "properties": own, "required": ["file"]}
    schema["$defs"]["RouteOfFile"] = of_file
    keys["route"]["anyOf"].insert(0, {"$ref": "#/$defs/RouteOfFile"})


def text_of(model: type[Table]) -> str:
    """The text of the file of a schema."""
    return json.dumps(schema_of(model), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for name, model in MODELS.items():
        (SCHEMAS / f"{name}.json").write_text(text_of(model), encoding="utf-8")
