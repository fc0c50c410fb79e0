"""Files that are text of no kind, too deep, too large, or say a thing twice."""

import json
import re
import time

import pytest
from places import SHIPPED_SCENARIOS

import flighttune as ft

TOML, JSON = ".toml", ".json"


def of_aircraft(path):
    """An aircraft's file has one name."""
    return ft.loop.JSBSimPlant(path.rename(path.with_name("aircraft.toml")).parent)


READERS = [
    (ft.load_scenario, TOML),
    (of_aircraft, TOML),
    (ft.load_gains, TOML),
    (ft.load_gains, JSON),
    (ft.verify, JSON),
    (ft.loop.load_identified, JSON),
]
EVERY_READER = pytest.mark.parametrize(
    ("read", "suffix"), READERS, ids=[f"{read.__name__}{suffix}" for read, suffix in READERS]
)


def refusal(read, path):
    with pytest.raises(ft.InputError) as caught:
        read(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path.parent}/")
    return line


def written(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@EVERY_READER
@pytest.mark.parametrize(
    ("toml", "json_", "message"),
    [
        (b"\xff\xfe", b"\xff\xfe", "must be UTF-8 text"),
        ("a = ", "{", "must be valid (TOML|JSON)"),
        (f"a = {'[' * 900}{']' * 900}", "[" * 100_000, "nested so deeply"),
        (f"a = {'{b = ' * 900}1{'}' * 900}", '{"a":' * 100_000 + "1" + "}" * 100_000, "so deeply"),
        (f"a = 1{'0' * 400}", f'{{"a": 1{"0" * 400}}}', "`"),
        ("a = 1\na = 2", '{"b": {"a": 1, "\\u0061": 2}}', "[Oo]verwrite|`a` is given twice"),
        ('a = "\\ud800"', '{"a": "\\ud800"}', "Unicode|`"),
        (b" " * 16_000_001, b" " * 16_000_001, "at most (1048576|16000000) bytes"),
    ],
    ids=["coding", "text", "arrays", "tables", "huge", "twice", "surrogate", "large"],
)
def test_what_no_file_of_ours_holds_is_refused_in_one_line(
    tmp_path, read, suffix, toml, json_, message
):
    path = written(tmp_path / f"wrong{suffix}", toml if suffix == TOML else json_)

    # What is no text of a claim has no kind that `verify` could name.
    assert re.search(f"{message}|or a damaged one", refusal(read, path))


@pytest.mark.parametrize("least", ["[],", "{},", "0,"])
def test_a_json_file_of_more_values_than_memory_holds_is_refused_unread(tmp_path, least):
    text = '{"a":[' + least * 2_100_000 + "0]}"

    said = refusal(ft.load_gains, written(tmp_path / "many.json", text))
    assert "at most 2097152 values" in said


@pytest.mark.slow
@EVERY_READER
def test_an_unknown_key_and_a_value_of_any_length_are_abridged(tmp_path, read, suffix):
    key, value = "k" * 5000, "v" * 5000
    text = f"{key} = '{value}'" if suffix == TOML else json.dumps({key: value})

    assert len(refusal(read, written(tmp_path / f"long{suffix}", text))) < 1000


def test_a_word_of_any_length_is_abridged_where_a_table_checks_itself(tmp_path):
    text = (SHIPPED_SCENARIOS / "paper.toml").read_text().replace('"paper"', f'"{"w" * 5000}"')

    assert len(refusal(ft.load_scenario, written(tmp_path / "long.toml", text))) < 1000


@pytest.mark.parametrize(
    ("read", "error", "words"),
    [
        (ft.load_gains, ft.InputError, "got a pipe or a device"),
        (ft.load, ft.RecordingError, "got no file"),
    ],
)
def test_a_file_without_an_end_is_not_read_to_its_end(read, error, words):
    with pytest.raises(error, match=words):
        read("/dev/zero")


@pytest.mark.parametrize("name", ["paper", "c172_cruise_turn"])
def test_line_ends_of_windows_are_read_as_those_of_unix(name, tmp_path):
    shipped = SHIPPED_SCENARIOS / f"{name}.toml"
    copy = tmp_path / shipped.name
    copy.write_bytes(shipped.read_bytes().replace(b"\n", b"\r\n"))

    assert ft.load_scenario(copy).as_dict() == ft.load_scenario(shipped).as_dict()


LONG = "x" * 1_000_000


@pytest.mark.parametrize(
    "text",
    [
        f'title = "{LONG}"',
        f"# {LONG}",
        f"{LONG} = 1",
        f'"{LONG.replace("xx", "x.")}" = 1',
        f'title = "{"a." * 500_000}"',
        f"a = [{','.join(['1.5'] * 50_000)}]",
    ],
    ids=["title", "comment", "key", "dots in a key", "dots in a title", "array"],
)
def test_a_long_word_is_read_in_one_pass(tmp_path, text):
    began = time.process_time()

    refusal(ft.load_gains, written(tmp_path / "long.toml", text))
    assert time.process_time() - began < 4.0  # in two nested passes: minutes


@pytest.mark.parametrize(
    "text", ["{} = 1", "[{}]", "[[{}]]", "a = {{ {} = 1 }}", "a = {{ b = 1, {} = 1 }}", "  {} = 1"]
)
@pytest.mark.parametrize("part", ["a", '"a b"', "'a.b'", "a ", "\ta"])
def test_a_deep_key_is_refused_at_once(tmp_path, text, part):
    began = time.process_time()

    deep = written(tmp_path / "deep.toml", text.format(".".join([part] * 30_000)))

    assert "nested so deeply" in refusal(ft.load_gains, deep)
    assert time.process_time() - began < 1.0  # by `tomllib`: 10 s


@pytest.mark.parametrize("text", ["a = 0x{}", "[a]\nb = [1, 0x{}]", "a = {{b = 0x{}}}"])
def test_an_integer_that_toml_does_not_have_is_refused_with_its_key(text, tmp_path):
    largest = written(tmp_path / "largest.toml", f"a = {2**63 - 1}\nb = {-(2**63)}")
    assert "valid TOML" not in refusal(ft.load_gains, largest)
    huge = written(tmp_path / "huge.toml", text.format("f" * 5000))
    assert re.search(r"valid TOML: `a.*` must be an integer", refusal(ft.load_gains, huge))
