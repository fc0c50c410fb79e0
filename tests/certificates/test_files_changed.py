"""Proofs of an identified model, and what they say once the file of the model is another."""

import json
from dataclasses import replace

import pytest

import flighttune as ft
from flighttune.files.shipped import aircraft_folder


@pytest.mark.slow
def test_a_proof_of_a_model_whose_file_has_changed_says_so(tmp_path):
    model, tube_file = tmp_path / "model.json", tmp_path / "tube.npz"
    text = (aircraft_folder("aerosonde") / "identified.json").read_text()
    model.write_text(text)
    tables = ft.load_scenario("paper").as_dict() | {"gains": ["paper"], "expect": []}
    tables["flight"]["duration_s"] = 0.5
    tables["plant"] = [{"kind": "point_mass_lag", "identified": str(model)}]
    tables["tuning"] |= {"model": "identified", "identified": str(model)}
    scenario = ft.scenario_from(tables)
    certificate = ft.certify(scenario, "paper").certificate
    certificate.save(tmp_path / "proof.json")
    law = ft.load_scenario("paper", changes={"flight.duration_s": 0.2})
    files = certificate.files  # as a tube of the same model has: that is longer to prove
    replace(ft.tube(law, "paper"), files=files).save(tube_file)
    flown = ft.fly(law, gains=["paper"])
    said = f"The files of {model} are no longer those that it was made with"
    for file in ("proof.json", "tube.npz"):
        assert said not in " ".join(ft.verify(tmp_path / file).answer().notes)
    assert any(run.claims for run in flown.within(ft.load(tube_file)).runs)

    model.write_text(json.dumps(json.loads(text) | {"seed": 12345}))

    for file in ("proof.json", "tube.npz"):
        assert said in " ".join(ft.verify(tmp_path / file).answer().notes)
    page = tmp_path / "proof.html"
    ft.report(tmp_path / "proof.json", page)
    assert "no longer those that it was made with" in page.read_text()
    with pytest.raises(ft.InputError, match=r"must be those .* proven"):
        flown.within(ft.load(tube_file))
