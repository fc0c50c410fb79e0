"""Silent wrong physics: found before the first flight, and said in one line."""

import pytest

import flighttune as ft


@pytest.mark.parametrize(
    ("name", "pattern", "replacement", "message"),
    [
        ("a4", '"A4"', '"737"', r"\[engines\] `count` must be that of the model, which has more"),
        (
            "a4", r"\[engines\]\n|\[envelope\]", "[engines]\ncount = 2\n\n[envelope]",
            r"must have the property `propulsion/engine\[1\]/set-running`",
        ),
        (
            "c172p", r"travel_deg = \[-28.0, 23.0\], full_rad = \[-0.4886, 0.40135\]",
            "travel_deg = [-20.0, 15.0], full_rad = [-0.35, 0.26]",
            r"`elevator` must move to 20 deg as `travel_deg` says, the model moves it by 27\.9 deg",
        ),
        (
            "c172p", r"full_rad = \[-0.2792, 0.2792\]", "full_rad = [0.2792, -0.2792]",
            r"`rudder` must raise r_dot at -16 deg, got -",
        ),
        (
            "a4", r"travel_deg = \[-7.0, 7.0\]", "travel_deg = [-20.0, 20.0]",
            r"`rudder` must have an effect up to -20 deg, it is saturated at half",
        ),
        (
            "aerosonde", r'command = "fcs/throttle-pos-norm"', 'command = "fcs/flap-cmd-norm"',
            r"engine 1 of 1 must push at full throttle",
        ),
    ],
)  # fmt: skip
def test_what_is_not_as_the_file_says_is_named(
    changed_aircraft, name, pattern, replacement, message
):
    folder = changed_aircraft("aircraft.toml", pattern, replacement, aircraft=name)

    start = ft.loop.FlightCondition(V_a=150.0 if name == "a4" else 50.0)
    with pytest.raises(ft.loop.PlantError, match=message) as error:
        ft.loop.JSBSimPlant(folder).start(start)
    assert "\n" not in str(error.value)


def test_gains_of_another_model_are_refused_and_none_say_what_writes_them(changed_aircraft):
    folder = changed_aircraft("aircraft.toml", "title", "title", aircraft="a4")
    file, start = folder / "aircraft.toml", ft.loop.FlightCondition(V_a=200.0)
    file.write_text(file.read_text().replace('"A4"', '"T38"'))

    with pytest.raises(ft.loop.PlantError, match=r"gains\.json: must be made"):
        ft.loop.JSBSimPlant(folder).start(start)
    (folder / "gains.json").unlink()
    with pytest.raises(ft.loop.PlantError, match=r"gains\.json: .*`flighttune design`"):
        ft.loop.JSBSimPlant(folder).start(start)
