"""docs/first_mission.md: its commands run as printed, and print the numbers that it shows."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from commands import flighttune

PAGE = (Path(__file__).parents[2] / "docs/first_mission.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(python|sh|text)\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
LEAVES = "flighttune mission mission.plan --aircraft c172p --page mission.html"


def follow(blocks, folder):
    """Do what a reader does."""
    printed = ""
    answers = [text for _, text in blocks[1:]] + [""]
    for (kind, text), after in zip(blocks, answers, strict=True):
        if kind == "python":
            (folder / "mission.py").write_text(text, encoding="utf-8")
        elif kind == "text":
            for line in text.strip().splitlines():
                assert " ".join(line.split()) in printed
        for line in text.splitlines() if kind == "sh" else ():
            program, *words = shlex.split(line)
            if program == "python":
                subprocess.run([sys.executable, *words], cwd=folder, check=True)
                continue
            status = int(after.startswith("No:"))
            printed = " ".join(" ".join(flighttune(*words, status=status, cwd=folder)).split())


@pytest.mark.slow
def test_the_plan_of_the_page_is_planned_as_it_says(tmp_path):
    first = next(i for i, (_, text) in enumerate(BLOCKS) if LEAVES in text)
    assert first == 4
    follow(BLOCKS[:first], tmp_path)


@pytest.mark.counts
def test_the_numbers_of_the_mended_plan_are_those_of_its_commands(tmp_path):
    """200 flights of four minutes; the count before it takes half as long."""
    mended = next(i for i, (_, text) in enumerate(BLOCKS) if "8.523" in text)

    follow([BLOCKS[0], *BLOCKS[mended:]], tmp_path)

    assert (tmp_path / "flown.plan").stat().st_size > 1000
    assert (tmp_path / "mission.html").exists()
