"""`--jsbsim` and `in_jsbsim`: JSBSim flies all steps, here and on every worker."""

import pickle

import pytest
from commands import flighttune
from flown_campaigns import plan

import flighttune as ft
from flighttune.base.files.code import jsbsim_flies
from flighttune.campaigns.engine.flyer import work_of
from flighttune.cli import options


@pytest.mark.parametrize("words", ["--jsbsim list", "list --jsbsim", "list"])
def test_the_option_stands_before_or_behind_a_command(words, monkeypatch):
    asked = []
    monkeypatch.setattr(options, "emit", lambda *_: asked.append(jsbsim_flies()))

    flighttune(*words.split())

    assert asked == ["--jsbsim" in words]
    assert not jsbsim_flies()


def test_every_worker_flies_as_its_command_says(tmp_path):
    ours = plan(tmp_path, runs=2)

    def jsbsim(work):
        *_, granted = pickle.loads(pickle.loads(work)[1])
        return granted.jsbsim

    assert not jsbsim(work_of(ours, {}))
    with ft.in_jsbsim():
        assert jsbsim(work_of(ours, {}))
