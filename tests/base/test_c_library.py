"""Machines whose C library rounds otherwise are told apart, by workers and by what is resumed."""

import json
import os
import subprocess
import sys

import pytest
from commands import answer

from flighttune.base.c_library import c_library
from flighttune.flight.fly import library_versions
from flighttune.flight.records.refly import changed_versions, other_versions

# glibc without FMA and AVX2 is that of another processor.
ELSEWHERE = os.environ | {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2"}
SAYS = """
import json
from flighttune.flight.fly import library_versions
print(json.dumps(library_versions()))
"""


def has_fma():
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return " fma " in file.read()
    except OSError:
        return False


needs_fma = pytest.mark.skipif(
    not (has_fma() and c_library().startswith("glibc")), reason="needs glibc on a processor of FMA"
)


@needs_fma
def test_another_processor_differs_by_the_c_library_alone():
    said = [
        json.loads(subprocess.run([sys.executable, "-c", SAYS], env=env, **RUN).stdout)
        for env in (os.environ, ELSEWHERE)
    ]

    assert said[0] == library_versions()
    assert changed_versions(said[1]).keys() == {"libc"}
    assert changed_versions(said[1])["libc"] == (said[1]["libc"], c_library())


RUN = {"capture_output": True, "text": True, "check": True}


def test_what_an_earlier_version_did_not_name_differs():
    earlier = {name: x for name, x in library_versions().items() if name != "libc"}

    assert changed_versions(earlier) == {}
    assert other_versions(earlier) == {"libc": ("absent", c_library())}


CAMPAIGN = """
title = "few"
scenario = "level_turn"
runs = {}
[[disperse]]
key = "flight.V_a_mps"
distribution = "uniform"
lower = 24.0
upper = 26.0
"""


@needs_fma
@pytest.mark.soak
def test_a_campaign_is_not_resumed_on_another_processor(tmp_path, monkeypatch):
    file = tmp_path / "few.toml"
    file.write_text(CAMPAIGN.format(1))
    answer("campaign", file, "--out", tmp_path / "c", status=None)
    file.write_text(CAMPAIGN.format(2))
    monkeypatch.setenv("GLIBC_TUNABLES", ELSEWHERE["GLIBC_TUNABLES"])
    again = [sys.executable, "-m", "flighttune", "campaign", file, "--out", tmp_path / "c"]
    done = subprocess.run([*again, "--resume"], capture_output=True, text=True, check=False)

    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert f"libc: was {c_library()}, is " in done.stderr
