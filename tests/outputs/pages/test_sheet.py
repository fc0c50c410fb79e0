"""The page of a mission prints as one A4 page, with its font inside, whole and without overlaps."""

import base64
import hashlib
import re
from dataclasses import replace
from pathlib import Path

import pytest
from browser import OVERLAPS, chromium_at_real_speed
from made_up_missions import counted_mission

import flighttune as ft
from flighttune.claims.hourly_flights import FlownTerm
from flighttune.claims.leaving import Volume
from flighttune.claims.mission import MissionOdds, per_hour_beside
from flighttune.claims.per_hour import PerHour
from flighttune.claims.rates_keys import KINDS
from flighttune.outputs.pages import sheet
from flighttune.outputs.pages.claim import write_claim_page

# Pixels of CSS, 96 per inch: the width of A4 without its margins.
MM = 96.0 / 25.4
WIDTH = round((210 - 2 * 12) * MM)

RANGES = {
    "stuck_deg": [-25, 25], "factor": [2, 8], "bias_mps": [-8, 8], "jump_m": [5, 50],
    "drift_mps": [0.1, 1],
}  # fmt: skip

# Texts that a box cuts off, or that stick out of the page, and numbers on two lines.
CUT = """[...document.querySelectorAll("h1, h2, h3, p, th, td, li, figcaption button")]
.filter(e => {
  const text = document.createRange();
  text.selectNodeContents(e);
  return e.checkVisibility() && (e.getBoundingClientRect().right > innerWidth + 1
    || getComputedStyle(e).display !== "inline" && e.scrollWidth > e.clientWidth + 1
    || e.matches("td:not(.word)") && text.getClientRects().length > 1)
}).map(e => e.textContent)"""


def every_fault(plan):
    """Exits per flight hour with each kind of fault, whose flights all stayed inside."""
    source = "failure modes and effects of the maker, table 3, and 12,000 h of a fleet"
    faults = [
        {"kind": name, "per_hour": 1e-3, "source": source, "flights": 30}
        | ({kind.range_key: RANGES[kind.range_key]} if kind.range_key else {})
        for name, kind in KINDS.items()
    ]
    terms = [
        FlownTerm(
            fault=fault,
            ended_s=None,
            left_s=(-1.0,) * 30,
            end_s=(60.0,) * 30,
            ended_at_s=(-1.0,) * 30,
        )
        for fault in (None, *range(len(faults)))
    ]
    square = ((-900.0, -900.0), (-900.0, 900.0), (900.0, 900.0), (900.0, -900.0))
    volume = Volume(rings=(square,), outside=(False,), low=None, high=None)
    rates = {"target_per_hour": 1e-2, "flights": 30, "fault": faults}
    return PerHour(
        rates=rates, confidence=0.9, plan=plan.as_dict(), volume=volume, terms=tuple(terms)
    )


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """A mission with all that can be counted, with made-up distances, and its files."""
    plan, band, room = counted_mission()
    file = tmp_path_factory.mktemp("sheet") / "m.npz"
    band.save(file)
    odds = MissionOdds(band=band, files={"band": file}, file=file)
    return odds.with_room(room).with_rate(every_fault(plan))


@pytest.fixture(scope="module")
def printed():
    """Print the page of a mission: the PDF, what lies on something else, and what is cut off."""
    with chromium_at_real_speed((WIDTH, 1000)) as open_tab:

        def of(mission):
            page = mission.file.with_suffix(".html")
            write_claim_page(mission.band, str(mission.file), page, mission)
            with open_tab(page.as_uri()) as tab:
                tab.until("document.readyState === 'complete'")
                told = tab.asked("Page.printToPDF", preferCSSPageSize=True)
                tab.asked("Emulation.setEmulatedMedia", media="print")
                tab.run("document.fonts.ready.then(() => true)")
                overlaps = tab.run(f"(() => {{{OVERLAPS} return overlaps;}})()")
                return base64.b64decode(told["data"]), overlaps, tab.run(CUT)

        yield of


def pages(pdf):
    return len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf))


@pytest.mark.slow
@pytest.mark.parametrize("faults", [True, False])
def test_a_mission_prints_as_one_page_of_a4(mission, printed, faults):
    pdf, overlaps, cut = printed(mission if faults else replace(mission, per_hour=None))

    assert pages(pdf) == 1
    box = re.search(rb"/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)", pdf)
    assert [float(x) / 72 * 25.4 for x in box.groups()] == pytest.approx([210, 297], abs=0.5)
    assert overlaps == []
    assert cut == []
    fonts = {*re.findall(rb"/FontName /[A-Z]{6}\+([\w-]+)", pdf)}
    assert fonts == {b"DejaVuSansCondensed", b"DejaVuSansCondensed-Bold"}


def test_a_terminal_has_the_answer_what_is_not_in_it_and_few_lines_of_tables(mission):
    """The rest is on the page and in JSON alone."""
    answer = mission.answer()

    shown = "\n".join(answer.text(120))

    first, rest = shown.split("\n\n", 1)
    assert len(first.splitlines()) <= 8
    assert "It holds for kinematic" in first
    assert len(rest.partition("Faults of other kinds")[2].splitlines()) <= 10
    whole = " ".join([*answer.summary, *answer.notes])
    for said in ("declared by the applicant", "--run ", "Of the exits per flight hour"):
        assert said in whole
        assert said not in shown


def test_conditions_claims_and_files_of_a_mission_are_its_own(mission):
    said, claims = sheet.conditions(mission), sheet.claims(mission)

    assert said["flights"] == "7 counted, 10 learned from; 7 counted that turn back; seed 0"
    assert said["aircraft"].startswith("kinematic, at ")
    assert said["operational volume"] == "the contingency volume"
    flown = mission.band.flights.gains
    roll, load = said["law"].partition(": ")[2].split("; ")
    for text, i in ((roll, 0), (load, 1)):
        numbers = [float(x) for x in re.findall(r"(?<![\w_])-?\d+\.\d+", text)]
        gains = [*flown.K_P[i], *flown.K_I[i]]
        assert sorted(numbers) == pytest.approx(sorted(x for x in gains if abs(x) > 5e-5), abs=1e-3)
    assert [*claims] == ["corridor", "room to turn back", "per flight hour", "not in it", "ground"]
    assert claims["not in it"].startswith("Faults of other kinds")
    alone = replace(mission, room=None, per_hour=None)
    assert [*sheet.claims(alone)] == ["corridor", "not in it", "ground"]
    assert sheet.claims(alone)["not in it"].startswith("Failures of engine")
    assert sheet.conditions(alone)["flights"] == "7 counted, 10 learned from; seed 0"
    assert sheet.volumes(alone) == []
    *_, sizes = sheet.volumes(mission)
    widths = {row["volume"]: row["width_m"] for row in sizes.records}
    # 5 m to a side, and 272 m to turn back
    assert (widths["flight geography"], widths["contingency volume"]) == pytest.approx((5.0, 277.0))
    (row,) = sheet.files_table(replace(alone, files={})).records
    digest = hashlib.sha256(mission.file.read_bytes()).hexdigest()
    assert [*row.values()] == ["m.npz", "flighttune verify m.npz", digest]


@pytest.mark.slow
def test_what_does_not_fit_makes_a_second_page(mission, printed):
    """So the check above can fail."""
    scenario = mission.band.flights.scenario
    title = scenario.model_copy(update={"title": "A very long title " * 300})
    flights = replace(mission.band.flights, scenario=title)
    pdf, *_ = printed(replace(mission, band=replace(mission.band, flights=flights)))

    assert pages(pdf) > 1


@pytest.mark.slow
def test_the_page_has_terms_volumes_claims_and_the_digest_of_each_file(mission):
    page = mission.file.with_suffix(".html")
    write_claim_page(mission.band, str(mission.file), page, mission)
    text = page.read_text()
    cells = re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", text)

    top = re.findall(r"<p[^>]*>(.*?)</p>", text[: text.index("<main>")])
    begins = "Not shown yet: at most", "The mission can be", "What matters most", "Of the exits"
    assert [
        x.removeprefix('<span aria-hidden="true">?</span> ').startswith(y)
        for x, y in zip(top, begins, strict=True)
    ] == [True] * 4
    for term in ("S_GPS", "S_Pos", "S_K", "S_RZ", "S_CM", "S_CV", "H_baro", "H_RZ", "H_CM", "H_CV"):
        assert term in cells
    assert cells[cells.index("operational volume") + 1] == "the contingency volume"
    # 5 m to a side, 272 m to turn back, and once more the height
    names = "flight geography", "contingency volume"
    sizes = [float(cells[cells.index(name) + 1]) for name in names]
    assert sizes == pytest.approx([5.0, 277.0], abs=0.11)
    files = [Path(file) for file in mission.files.values()]
    assert len(files) == 5
    for file in files:
        assert cells[cells.index(file.name) + 2] == hashlib.sha256(file.read_bytes()).hexdigest()
    claims = cells[cells.index("corridor") : cells.index("not in it")]
    assert claims[::2] == ["corridor", "room to turn back", "per flight hour"]
    assert all(claim[0].isupper() and claim.endswith(".") for claim in claims[1::2])
    # Headline and claim state the same number, which is not below the bound.
    stated = {float(x) for x in re.findall(r"[Aa]t most ([\d.]+) flights per flight hour", text)}
    (number,) = stated
    assert mission.per_hour.bound.total <= number <= 1.01 * mission.per_hour.bound.total


@pytest.mark.slow
def test_a_page_written_later_has_what_the_files_beside_the_band_count(mission, tmp_path):
    page = tmp_path / "page.html"
    write_claim_page(mission.band, str(mission.file), page, mission)
    later = ft.report(mission.file, tmp_path / "later.html").path

    assert later.read_text() == page.read_text()
    # The files of another mission beside it are not this one's.
    moved = {**mission.per_hour.plan, "gains": []}
    replace(mission.per_hour, plan=moved).save(per_hour_beside(mission.file))
    try:
        text = ft.report(mission.file, later).path.read_text()
        assert "flights per flight hour" not in text
        assert "per flight hour beside it are not used" in text
    finally:
        mission.per_hour.save(per_hour_beside(mission.file))
