"""The log (CSV) of a level turn: a ramp of the course from 2 s to 11 s at 10 deg/s, then level."""

import flighttune as ft

UNITS = {"chi": "rad", "gamma": "rad", "phi": "rad", "chi_ref": "rad", "gamma_ref": "rad"}
UNITS |= dict.fromkeys(("V_a", "V_g"), "mps") | dict.fromkeys(("north", "east", "down"), "m")
UNITS |= {"n_z": ""}


def logged_turn(path, *left_out):
    """Write the log without some signals; return its path."""
    run = ft.fly("level_turn", "paper")["jsbsim:aerosonde / paper"]
    kept = [name for name in UNITS if name not in left_out]
    names = {name: f"{name}_{UNITS[name]}".rstrip("_") for name in kept}
    run.signals[kept].rename(columns=names).rename_axis("t_s").reset_index().to_csv(
        path, index=False
    )
    return path
