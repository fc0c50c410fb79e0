"""What is left out of a scenario, a campaign or a call means what it meant in releases before."""

import inspect
import math
import re

import pytest
from pydantic import BaseModel

import flighttune as ft

# Defaults of release 0.4.0 by table, but for keys that are None, empty or False without a value.
SCENARIO = {
    "": {"gains": ["paper", "tuned"]},
    "flight": {"h_m": 1000.0, "start": "course", "duration_s": 20.0, "g_mps2": 9.81},
    "route": {"margin": 0.2, "gamma_deg": (-10.0, 10.0), "look_ahead_s": 3.0},
    "route.ending": {"side": 1},  # since 0.5.0
    "plant.airframe.fault": {"ended_by": "cut"},  # since 0.5.0
    "turn_back": {"side": 1, "turn_deg": 180.0, "detected_s": 10.0, "reaction_s": 1.0},
    "navigation": {"grade": "standard"},
    "controller": {"rate_hz": 50.0, "anti_windup": "conditional"},
    "tuning": {
        "I_star": 5.0, "model": "kinematic", "structure": "full", "objective": "R_K", "starts": 12
    },
    "disturbance": {"path": "ground"},
    "turbulence": {"model": "tustin"},
}  # fmt: skip
CAMPAIGN = {
    "": {"design": "random", "time_limit_s": 60.0},
    "disperse": {"acts": "sets", "distribution": "grid"},
    "keep": {"failures": 20, "worst": 5, "worst_by": "chi.ITAE", "sample": 5},
    "plant.airframe.fault": {"ended_by": "cut"},  # since 0.5.0
}


# Numbers of options of verbs that stand for themselves, if they are not zero.
OPTIONS = {
    "frontier": {"points": 25}, "identify": {"h": 1000.0}, "load_log": {"end": math.inf},
    "monitor": {"epsilon": 0.05, "confidence": 0.95, "learn": 100}, "report": {"confidence": 0.95},
    "open": {"budget": 400}, "residual": {"epsilon": 0.01, "confidence": 0.999, "learn": 500},
    "show": {"width": 1280, "height": 720}, "trim": {"h": 1000.0},
    "worst": {"budget": 2000, "seed": 1},
}  # fmt: skip


def leaves(annotation):
    """Every class in an annotation."""
    if isinstance(annotation, type) and not getattr(annotation, "__args__", ()):
        return [annotation]
    return [leaf for part in getattr(annotation, "__args__", ()) for leaf in leaves(part)]


def defaults(model, place="", found=None):
    """Values of the keys that are left out, by table and key, of a model and all tables in it."""
    found = {} if found is None else found
    for name, field in model.model_fields.items():
        key = field.alias or name
        value = None if field.is_required() else field.get_default(call_default_factory=True)
        # Factors on what a model has are 1.
        if isinstance(value, BaseModel) or (name.endswith("_factor") and value == 1.0):
            value = None
        if value is not None and value not in ("", 0, 0.0, False) and value not in ([], {}):
            found.setdefault(place, {})[key] = value
        for leaf in leaves(field.annotation):
            if issubclass(leaf, BaseModel):
                defaults(leaf, f"{place}.{key}".strip("."), found)
    return found


def test_keys_that_are_left_out_of_a_scenario_mean_what_they_meant():
    assert defaults(ft.Scenario) == SCENARIO


def test_keys_that_are_left_out_of_a_campaign_mean_what_they_meant():
    found = defaults(ft.Campaign)
    whole = {"nominal", "central"}  # scenarios in a campaign
    own = {place: keys for place, keys in found.items() if place.split(".")[0] not in whole}
    assert own == CAMPAIGN


def test_numbers_that_are_left_out_of_a_call_mean_what_they_meant():
    found = {}
    for name, verb in ((name, getattr(ft, name)) for name in dir(ft)):
        if inspect.isfunction(verb):
            for option, parameter in inspect.signature(verb).parameters.items():
                number = isinstance(parameter.default, int | float) and parameter.default
                if number and not isinstance(number, bool):
                    found.setdefault(name, {})[option] = number
    assert found == OPTIONS


def documented():
    """Verb, option and default in words of each number whose docstring says the default."""
    for name in sorted(dir(ft)):
        verb = getattr(ft, name)
        if not inspect.isfunction(verb) or not verb.__doc__:
            continue
        text = re.sub(r"\s+", " ", verb.__doc__.split("Returns\n")[0])
        for option, parameter in inspect.signature(verb).parameters.items():
            said = re.search(rf" {option} : [^:]*?by default (-?[\d.]*\d)", text)
            if said and isinstance(parameter.default, int | float):
                yield name, option, float(said[1])


@pytest.mark.parametrize(("verb", "option", "said"), [*documented()])
def test_the_default_of_an_option_is_the_documented_one(verb, option, said):
    assert inspect.signature(getattr(ft, verb)).parameters[option].default == said
