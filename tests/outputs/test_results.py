"""Each result has its answer: an exit status, words with numbers, and tables that print them."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft

DEG = 180.0 / np.pi
SLOW = ("beside", "campaign", "corridor", "frontier", "infeasible", "meeting", "mission")
LONG = ("infeasible",)
SLOW += ("outside", "residual", "monitor", "band", "worst", "tube", "gradient", "identified")
ROWS = [
    [part.strip() for part in line.split("|")]
    for line in Path(__file__).with_name("results.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
]
WIDTHS = 60, 79, 100, 300


def facts(r, v, values):
    """What rows may ask of a result, its answer's values and its JSON."""

    def itae(run, channel="chi"):
        return ft.loop.channel_metrics(run).at[channel, "ITAE"]

    def steps(channel):
        rows = [(float(x.metrics.at[channel, "ITAE"]), x.adds) for x in r.steps]
        return max(rows, key=lambda row: abs(row[0]))

    def margins(r):
        """The least phase margin of a result of each loop, deg."""
        return min(row["phase_margin_deg"] for row in values["margins"][:2])

    def needed():
        """Command by an error of a degree, deg and 1: the largest gain of a fast error."""
        return ft.PAPER_GAINS.K_P[0, 0], ft.PAPER_GAINS.K_P[1, 1] / DEG

    def slopes():
        row = max(values["slopes"], key=lambda x: abs(x["value"] * x["slope"]))
        return row["parameter"], 0.1 * row["value"] * row["slope"]

    def count(side):
        return r.metrics["better"].tolist().count(side)

    def widest(i):
        row = values["half_widths"][i]
        return max(abs(row["low"]), abs(row["high"]))

    def errors(i):
        row = values["accuracy"][i]
        return row["yours"], row["ours"]

    def slowest(r):
        return -np.linalg.eigvals(ft.loop.closed_loop(r.model, r.gains)).real.max()

    names = locals() | {"np": np}
    if "slopes" in values:
        names["largest"] = slopes()
    if "certificate" in values and isinstance(values["certificate"], dict):
        names["exact"] = (values["certificate"].get("exact_rates") or [None])[0]
    return names


NUMBER = r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def wanted(part, names):
    """A pattern of words with numbers, and the numbers that must stand there."""
    words, asked = re.split(r"\{(.*?)\}", part)[::2], re.split(r"\{(.*?)\}", part)[1::2]
    values = [eval(one, dict(names)) for one in asked]
    pattern = re.escape(words[0])
    for value, after in zip(values, words[1:], strict=True):
        pattern += f"({re.escape(value)})" if isinstance(value, str) else f"({NUMBER})"
        pattern += re.escape(after)
    return pattern.replace(r"\ ", r"\s"), values


def digit(text):
    """One in the last digit of a number."""
    mantissa, _, exponent = text.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


@pytest.mark.parametrize(
    ("name", "status", "parts"),
    [
        pytest.param(
            name,
            status,
            parts,
            id=name,
            marks=[pytest.mark.slow] * (name in SLOW) + [pytest.mark.soak] * (name in LONG),
        )
        for name, status, *parts in ROWS
    ],
)
def test_a_result_answers_in_words_with_its_numbers(results, name, status, parts):
    result = results.of(name)
    said = result.answer()
    text = " ".join([*said.summary, said.verdict, said.failure, *said.changed, *said.notes])
    values = json.loads(said.json())

    assert said.status == int(status)
    assert bool(said.failure) == (said.status != 0)
    names, at = facts(result, said.values, values), 0
    for part in filter(None, parts):
        pattern, numbers = wanted(part, names)
        found = re.compile(pattern).search(text, at)
        assert found, f"{part!r} is not in {text[at:]!r}"
        for told, number in zip(found.groups(), numbers, strict=True):
            if not isinstance(number, str):
                told = told.replace("−", "-")
                assert float(told) == pytest.approx(number, abs=1.001 * digit(told)), part
        at = found.end()
    check_tables(said)
    check_json(said, values)


def check_tables(said):
    """Each table prints its records in their units, in any width, on a page and in Markdown."""
    for table in said.tables:
        rows = table.rows
        assert len(rows) == len(table.records)
        for row, record in zip(rows, table.records, strict=True):
            assert len(row) == len(table.columns)
            for column, cell in zip(table.columns, row, strict=True):
                value = value_of(record, column.key)
                if isinstance(value, float) and np.isfinite(value) and cell[0] in "-+0123456789":
                    in_degrees = column.unit in ("deg", "deg/s") and "_deg" not in column.key
                    factors = {1.0, DEG} if in_degrees else {1.0, 100.0}
                    told = float(re.match(NUMBER, cell)[0])
                    off = 1.001 * digit(re.match(NUMBER, cell)[0])
                    assert any(abs(told - value * x) <= off for x in factors), (column, record)
                elif value is None or (isinstance(value, float) and np.isnan(value)):
                    assert not re.search(r"\d", cell), (column, record)
                elif isinstance(value, bool):
                    assert cell == ("yes" if value else "no")
                elif isinstance(value, int | str) and value != "":
                    assert str(value) in cell.replace("∞", "inf"), (column, record)
        if rows:
            check_shown(table, rows)


def check_shown(table, rows):
    """A table in lines of any width, in HTML and in Markdown has all of its cells."""
    for width in WIDTHS:
        lines = replace(table, title="").text(width).splitlines()
        for line in lines:
            assert len(line) <= width or max(map(len, line.split())) > width / 3, line
        letters = re.sub(r"\s|─", "", "".join(lines))
        for row in rows:
            for cell in row[:1]:
                if width == WIDTHS[-1]:
                    assert re.sub(r"\s", "", cell) in letters
    cells = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", table.html())
    assert len(cells) == len(table.columns) * (len(rows) + bool(table.head))
    _, rule, *marked = table.markdown().splitlines()
    assert len(marked) == len(rows)
    for place, (column, sign) in enumerate(
        zip(table.columns, rule.strip("| ").split("|"), strict=True)
    ):
        numbers = [value_of(x, column.key) for x in table.records]
        is_number = any(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)
        assert sign.strip().endswith(":") == is_number, (column, place)


def value_of(record, key):
    """The value at a dotted key; None if it is missing."""
    if not isinstance(record, dict):
        if not isinstance(record, list | tuple) or not key.partition(".")[0].isdigit():
            return None
        record = {str(i): x for i, x in enumerate(record)}
    if key in record:
        return record[key]
    for i, letter in enumerate(key):
        if letter == "." and key[:i] in record:
            return value_of(record[key[:i]], key[i + 1 :])
    return None


def check_json(said, values):
    """The JSON has its verdict, its sentences and files, and no number that JSON lacks."""
    assert values["verdict"] == (said.verdict or said.failure)
    assert values["notes"] == [*said.changed, *said.notes]
    assert values.get("summary", []) == list(said.summary)
    assert {*said.values} <= {*values}
    assert "NaN" not in said.json()
    assert [values[key] for key in said.files] == [x and str(x) for x in said.files.values()]
    for width in WIDTHS[1:]:
        paragraphs = " ".join(said.text(width)).split()
        for sentence in said.summary or [said.verdict]:
            if sentence not in said.aside:
                first = " ".join(f"{sentence[:1].upper()}{sentence[1:]}".split())
                assert first.rstrip(".").lower() in " ".join(paragraphs).lower(), sentence
