"""The identify command as a user meets it."""

import json

import pytest
from commands import flighttune

import flighttune as ft

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def aerosonde(tmp_path_factory):
    out = tmp_path_factory.mktemp("identified") / "aerosonde.json"
    printed, _ = flighttune("identify", "aerosonde", "--out", out, "--json")
    return json.loads(printed), out


def test_the_model_file_can_be_tuned_on(aerosonde, tmp_path):
    found, out = aerosonde
    scenario = tmp_path / "mine.toml"
    scenario.write_text(
        'title = "mine"\n[flight]\nV_a_mps = 25.0\n[reference]\nchi_deg = 10.0\ngamma_deg = 0.0\n'
        f'[tuning]\nmodel = "identified"\nidentified = "{out}"\n[[plant]]\nkind = "kinematic"\n'
    )

    tuned = json.loads(flighttune("tune", scenario, "--json")[0])

    assert ft.load_identified(out).conditions[0].lags[0].order == found["channels"]["phi"]["order"]
    assert tuned["status"] == "optimal"
    assert tuned["K_P"][0][1] == tuned["K_P"][1][0] == 0.0
    assert 2.0 < tuned["K_P"][0][0] < 5.0
