"""Machines whose C library rounds otherwise are told apart by recordings and campaigns."""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from commands import answer

import flighttune as ft

# glibc without FMA and AVX2 is that of another processor.
ELSEWHERE = os.environ | {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2"}
CAMPAIGN = """
title = "few"
scenario = "level_turn"
runs = {}
disperse = [{{ key = "flight.V_a_mps", distribution = "uniform", lower = 24.0, upper = 26.0 }}]
"""


def has_fma():
    flags = Path("/proc/cpuinfo")
    return flags.exists() and " fma " in flags.read_text(encoding="utf-8")


pytestmark = pytest.mark.skipif(
    not (has_fma() and platform.libc_ver()[0] == "glibc"), reason="needs glibc and FMA"
)


def elsewhere(*words):
    command = [sys.executable, "-m", "flighttune", *map(str, words)]
    return subprocess.run(command, env=ELSEWHERE, capture_output=True, text=True, check=False)


def test_a_flight_names_the_c_library_and_the_machine():
    (run, *_) = ft.fly("level_turn", gains=["paper"]).runs

    name, version = platform.libc_ver()
    said = run.provenance.versions["libc"]
    known = f"{name} {version} {platform.machine()}, values "
    assert said.startswith(known)
    assert len(bytes.fromhex(said.removeprefix(known))) == 6


@pytest.mark.soak
def test_another_processor_differs_by_the_c_library_alone(tmp_path):
    ft.record(ft.fly("paper_as_printed", gains=["paper"]), tmp_path, name="run")

    here = answer("verify", tmp_path)
    there = json.loads(elsewhere("verify", tmp_path, "--json").stdout)

    assert here["versions"] == {}
    assert here["equal"]
    assert there["versions"].keys() == {"libc"}
    assert there["versions"]["libc"]["recorded"] != there["versions"]["libc"]["now"]


@pytest.mark.soak
def test_a_campaign_is_not_resumed_on_another_processor(tmp_path):
    file = tmp_path / "few.toml"
    file.write_text(CAMPAIGN.format(1))
    answer("campaign", file, "--out", tmp_path / "c", status=None)
    file.write_text(CAMPAIGN.format(2))

    done = elsewhere("campaign", file, "--out", tmp_path / "c", "--resume")

    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "libc: was glibc" in done.stderr
