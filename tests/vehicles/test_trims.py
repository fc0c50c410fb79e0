"""`trim` says whether an aircraft is compiled, or why JSBSim flies it."""

import pytest
from airframes import changed_aerosonde

import flighttune as ft
from flighttune.outputs.answers.trim import who_flies


def noisy(text):
    function = '<function name="aero/noise"><random/></function>'
    return text.replace("<aerodynamics>", f"<aerodynamics>{function}")


@pytest.mark.parametrize(
    ("change", "reason"),
    [(str, ""), (noisy, "the compiled step does not know <random> in a function")],
    ids=["compiled", "refused"],
)
def test_the_trims_of_an_aircraft_say_why_it_is_not_compiled(tmp_path, change, reason):
    aircraft = changed_aerosonde(tmp_path / "aircraft", change)

    trims = ft.trim(aircraft, V_a=[25.0], gamma=[0.0])

    assert trims.not_compiled == reason
    assert who_flies(reason) in trims.answer().notes
    assert who_flies("") == "Long flights are compiled."
    assert "itself: a part is not known" in who_flies("a part is not known")
