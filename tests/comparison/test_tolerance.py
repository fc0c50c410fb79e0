"""Tolerances: what counts as a change, and what a tolerance file may say."""

import math

import pytest

from flighttune.comparison import compare
from flighttune.comparison.tolerance import Tolerance, load_tolerances, violations
from flighttune.errors import InputError


@pytest.fixture
def tolerances(tmp_path):
    def read(text):
        path = tmp_path / "tolerance.toml"
        path.write_text(text)
        return load_tolerances(path)

    return read


@pytest.mark.parametrize(
    ("tolerance", "a", "b", "allowed"),
    [
        (Tolerance(absolute=0.5), 2.0, 2.5, True),
        (Tolerance(absolute=0.5), 2.0, 2.6, False),
        (Tolerance(relative=0.1), -2.0, -2.15, True),
        (Tolerance(relative=0.1), 2.0, 1.7, False),
        (Tolerance(absolute=0.1, relative=0.1), 2.0, 2.25, True),
        (Tolerance(relative=0.1, only_worse=True), 2.0, 1.0, True),
        (Tolerance(relative=0.1, only_worse=True), 2.0, 3.0, False),
        (Tolerance(absolute=9.0), math.nan, math.nan, True),
        (Tolerance(absolute=9.0), 2.0, math.nan, False),
        (Tolerance(absolute=0.0), 2.0, 2.0, True),
    ],
)
def test_a_change_is_allowed_up_to_absolute_plus_relative_of_the_first(tolerance, a, b, allowed):
    assert tolerance.allows("settling_s", a, b) is allowed


def test_equal_runs_are_within_zero_tolerance(fly_line, tolerances):
    strict = tolerances("ITAE = {absolute = 0}\nmax_distance_m = {absolute = 0}\n")

    assert violations(compare(fly_line(), fly_line()), strict) == []


def test_the_offending_metric_is_named_with_both_values(fly_line, tolerances):
    found = compare(fly_line(rate=0.5), fly_line(rate=2.0))

    out = violations(found, tolerances("[chi]\nrise_s = {absolute = 0.1}\n"))

    assert [(one.channel, one.name) for one in out] == [("chi", "rise_s")]
    assert (out[0].a, out[0].b) == pytest.approx((math.log(9) / 0.5, math.log(9) / 2), rel=1e-3)
    assert "chi rise_s must be within 0.1 of 4.39" in out[0].sentence


def test_a_channel_goes_before_the_metric_of_all_channels(fly_line, tolerances):
    found = compare(fly_line(rate=0.5), fly_line(rate=2.0))

    out = violations(found, tolerances("rise_s = {absolute = 0}\n[chi]\nrise_s = {absolute = 9}\n"))

    assert [one.channel for one in out] == ["gamma"]


def test_paths_that_part_are_out_of_tolerance(fly_line, tolerances):
    found = compare(fly_line(), fly_line(offset=(0.0, 3.0, 4.0)))

    assert not violations(found, tolerances("max_distance_m = {absolute = 5.1}\n"))
    out = violations(found, tolerances("max_distance_m = {absolute = 4.9}\n"))
    assert out[0].b == pytest.approx(5.0)


def test_a_run_that_ends_early_is_out_of_any_tolerance(fly_line, tolerances):
    found = compare(fly_line(), fly_line(seconds=5.0, status="hit_ground"))

    out = violations(found, tolerances("ITAE = {absolute = 1e9}\n"))

    assert [(one.name, one.a, one.b) for one in out] == [("duration_s", 20.0, 5.0)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ITEA = {absolute = 1}", "`ITEA` is not a known key; did you mean `ITAE`"),
        ("[chi]\nalpha_max_rad = {absolute = 1}", r"\[chi\] `alpha_max_rad` is not a known key"),
        ("ITAE = {absolut = 1}", r"\[ITAE\] `absolut` is not a known key; did you mean `absolute`"),
        ("ITAE = {absolute = '1'}", r"\[ITAE\] `absolute` must be a valid number, got '1'"),
        ("ITAE = {absolute = -1}", r"\[ITAE\] `absolute` must be .*0.*, got -1"),
        ("ITAE = {absolute = nan}", r"\[ITAE\] `absolute` must be a finite number, got nan"),
        ("ITAE = {only_worse = true}", r".*ITAE.* must give `absolute` or `relative`"),
        ("ITAE = 3", "`ITAE` must be a table.*, got 3"),
        ("", "the file must hold a tolerance for at least one metric"),
        ("ITAE = ", "the file must be valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_with_file_and_key(tolerances, text, message):
    with pytest.raises(InputError, match=rf"tolerance\.toml: {message}"):
        tolerances(text)
