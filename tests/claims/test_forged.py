"""Every kind of claim: its file, its check, its page, and a forger whom nothing is believed."""

import copy
import html
import random
import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from commands import answer
from flown_campaigns import flown_here
from forging import Opened, changed, forged, same
from small_claims import FLOWN, KINDS, OLD, band, log_monitor, old, proven

import flighttune as ft
from flighttune.base.files.load import CLAIMS
from flighttune.claims.about import KINDS as COUNTS

SEED = 105
DOCS = Path(ft.__file__).parents[1] / "docs"

# The kind of each file of 0.3.0; of the others that version had none, or another format.
OF_OLD = {
    "flighttune certificate": "certificate.json",
    "flighttune rate bound": "bound.json",
    "flighttune tube": "tube.npz",
    "flighttune band": "band.npz",
}
NOT_OLD = {
    "flighttune band of residual": "its files name an aircraft whose files have changed since",
    "flighttune band of monitor": "counted since 0.4.0",
    "flighttune band of turn_back": "0.3.0 counted another distance, and is told so",
    "flighttune monitor": "learned since 0.4.0",
    "flighttune flight hours": "counted since 0.5.0",
}
# The page of the docs about each kind.
PAGES = {
    "flighttune certificate": "certificate", "flighttune rate bound": "which_bound",
    "flighttune tube": "tube", "flighttune band": "bands",
    "flighttune band of residual": "residual", "flighttune band of monitor": "monitor",
    "flighttune band of turn_back": "missions", "flighttune monitor": "monitor",
    "flighttune flight hours": "per_hour",
}  # fmt: skip


def test_every_kind_of_claim_has_its_maker_its_forger_its_old_file_or_a_reason_and_its_page():
    kinds = {*CLAIMS} | {f"flighttune band of {of}" for of in COUNTS if of}

    assert {*KINDS} == kinds == {*OF_OLD} | {*NOT_OLD} == {*PAGES}
    assert not {*OF_OLD} & {*NOT_OLD}
    for kind, name in OF_OLD.items():
        assert (OLD / name).exists(), kind
    for kind, page in PAGES.items():
        text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
        assert kind.split()[-1].split("_")[0] in text, kind


def kinds(*but):
    """All kinds of claims; those of missions are slow."""
    return [pytest.param(kind, marks=[pytest.mark.slow] * (kind in FLOWN))
            for kind in KINDS if kind not in but]  # fmt: skip


def believed(path, **by):
    """What a file claims, if `verify` finds it valid; else None, and its reason in one line."""
    try:
        with flown_here():
            verified = ft.verify(path, **by)
    except ft.InputError:
        return None
    assert "\n" not in verified.reason
    return verified if verified.valid else None


@pytest.mark.soak
@pytest.mark.parametrize("kind", kinds())
def test_each_kind_is_read_verified_and_shown_on_a_page_with_its_sentence(kind, tmp_path):
    file = KINDS[kind][0]()
    count = {"count": 2} if "band" in kind or "hours" in kind else {}

    verified = believed(file, **count)

    claim = ft.load(file)
    assert verified is not None
    assert verified.claim.sentence == claim.sentence
    assert Opened.of(file).tables["format"].startswith(" ".join(kind.split()[:2]))
    if "hours" in kind:
        return  # it is shown with its mission
    page = tmp_path / "page.html"
    printed = answer("report", file, "--out", page, status=None)
    text = html.unescape(page.read_text(encoding="utf-8"))
    assert printed["verdict"] == claim.sentence or claim.sentence in " ".join(printed["summary"])
    assert claim.sentence[1:60] in text


def several(kind, draw, number):
    """Forgeries that say other things than the honest file."""
    whole, other = (Opened.of(maker()) for maker in KINDS[kind])
    while number:
        opened, place = forged(whole, other, draw)
        if not same(opened, whole):
            number -= 1
            yield opened, place


@pytest.mark.soak
@pytest.mark.parametrize("kind", kinds())
def test_a_file_that_was_edited_is_believed_in_no_place(kind, tmp_path):
    for opened, place in several(kind, random.Random(SEED), 12):
        name = KINDS[kind][0]().name
        assert believed(opened.write(tmp_path / name, anew=False)) is None, place


# Places of which another value is as true, by the last keys: what is a name, a note or a choice of
# the maker, and of what a proof holds for a narrower envelope or a larger bound too.
AS_TRUE = {
    *("title", "note", "units", "version", "name", "source", "settings", "start_rad", "files"),
    *("R_bound", "I_star", "envelope", "conditions", "disturbance_rad_s", "endings", "compiled"),
    *("epsilon", "confidence", "fences", "planned", "early", "success", "keep", "navigation"),
    *("expect", "runs", "seconds", "digest", "held", "bounds", "chosen", "by_rtk", "seed"),
}


@pytest.mark.soak
@pytest.mark.parametrize("kind", [x for x in KINDS if x not in FLOWN])
def test_with_a_hash_made_anew_no_file_says_more_than_is_so(kind, tmp_path):
    seen = Counter()
    honest = ft.load(KINDS[kind][0]()).sentence
    for opened, place in several(kind, random.Random(SEED + 1), 20):
        verified = believed(opened.write(tmp_path / KINDS[kind][0]().name), **(
            {"count": 7} if "band" in kind else {}))  # fmt: skip
        if verified is None:
            seen["not valid"] += 1
        elif verified.claim.sentence == honest:
            seen["says the same"] += 1
        else:
            keys = {key for key in place if isinstance(key, str)}
            assert keys & AS_TRUE, f"{place}: {verified.claim.sentence}"
            seen["tells it"] += 1
    sys.stdout.write(f"{dict(seen)}\n")
    assert seen["not valid"] > 5


def test_a_file_without_its_seal_is_not_taken_for_an_old_one(tmp_path):
    for maker in (lambda: old("certificate.json"), band, log_monitor, proven):
        opened = Opened.of(maker())
        opened.tables.pop("sha256", None)
        path = opened.replace_comment(b"").write(tmp_path / maker().name, anew=False)
        assert believed(path) is None


# ---------------------------------------------------------------- every check has what fails it
def scaled(*path, by=1.01):
    """A change of one number, or of all of a list, deep in the tables."""

    def change(tables):
        for key in path[:-1]:
            tables = tables[key]
        tables[path[-1]] = (by * np.array(tables[path[-1]])).tolist()

    return change


def checks_of(path):
    """Names of checks that do not hold; and of all."""
    checks = ft.verify(path).checks
    return {x.name for x in checks if not x.exact}, {x.name for x in checks}


def fields(value, path=()):
    """The first number of every field, by its path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from fields(inner, (*path, key))
    elif isinstance(value, list) and value:
        yield from fields(value[0], (*path, 0))
        yield from fields(value[-1], (*path, len(value) - 1))
    elif isinstance(value, float):
        yield path


# Checks that nothing fails but a file that is refused: positive numbers, and what is stated alike.
FOLLOW = {"L_d", "radius", "rate", "the integral is that of the law of the gains"}


@pytest.mark.soak
@pytest.mark.parametrize("name", ["certificate.json", "certificate_envelope.json", "bound.json"])
def test_each_check_of_a_proof_about_gains_has_a_number_whose_change_fails_it(name, tmp_path):
    file, failed = old(name), set()
    _, every = checks_of(file)
    for path in fields(Opened.of(file).tables):
        for by in (1.3, -1.0):
            try:
                failed |= checks_of(changed(file, tmp_path / name, scaled(*path, by=by)))[0]
            except ft.InputError:
                continue

    def kinds_of(checks):
        return {re.split(r" [>(]| \[", "".join(x for x in y if not x.isdigit()))[0] for y in checks}

    assert kinds_of(every) - kinds_of(failed) <= FOLLOW


LOGS = {
    "weights of": scaled("logs", 0, "models", 0, "weights", by=1.001),
    "limits of": scaled("logs", 0, "limits", by=1.0001),
    "score of": scaled("logs", 1, "score"),
    "largest residuals of": lambda x: [scaled("logs", i, "peaks", by=0.01)(x) for i in range(4)],
    "model of the score": lambda x: x["logs"][0].update(why="roll"),
    "numbers of logs": lambda x: x["logs"].pop(),
    "among 8": lambda x: x.update(logs=x["logs"] + copy.deepcopy(x["logs"])),
    "digests, 4 among 8": lambda x: x.update(logs=x["logs"] + [
        {**log, "digest": f"{i}"} for i, log in enumerate(copy.deepcopy(x["logs"]))]),
    "moments of": scaled("logs", 0, "moments", by=0.01),
}  # fmt: skip


@pytest.mark.parametrize("reason", LOGS)
def test_each_check_of_a_monitor_of_logs_has_a_change_that_fails_it(reason, tmp_path):
    file = changed(log_monitor(), tmp_path / "m.npz", LOGS[reason])

    verified = ft.verify(file)

    assert not verified.valid
    words = {"digests, 4 among 8": "4 among 8", "moments of": "weights of"}.get(reason, reason)
    failed = [verified.reason, *(x.name for x in verified.checks if not x.exact)]
    assert any(words in x for x in failed)
    honest = ft.verify(log_monitor())
    assert honest.valid
    assert {x.name.split()[0] for x in honest.checks} == {"weights", "limits", "score"}
