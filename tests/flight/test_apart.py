"""A copy of the process: what it answers, reports and fails of, and how it ends."""

import os
import signal
import time

import pytest

import flighttune as ft
from flighttune.base.errors import PlantError
from flighttune.flight.apart import apart

LONG_S = 60.0


def test_an_answer_and_its_reports_come_back_and_the_process_stays_as_it_is():
    here, reports = [], []

    def work(report):
        here.append(1)
        report("first", 0.25)
        report("second", 0.5)
        return {"answer": os.getpid()}

    answer, end, part = apart(work, LONG_S, lambda *seen: reports.append(seen))

    assert answer["answer"] != os.getpid()
    assert (end, part) == ("", 1.0)
    assert reports == [("first", 0.25), ("second", 0.5)]
    assert here == []


def test_an_error_of_the_copy_is_raised_here_and_what_cannot_be_copied_is_one():
    def refused(_):
        raise ft.InputError("`x` must be another.")

    with pytest.raises(ft.InputError, match="`x` must be another"):
        apart(refused, LONG_S)
    with pytest.raises(PlantError, match="must return what can be copied"):
        apart(lambda _: lambda: 3, LONG_S)


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "SIGKILL"),
        (lambda: os._exit(3), "exit status 3"),
        (lambda: os.kill(os.getpid(), signal.SIGTERM), "SIGTERM"),
    ],
)
def test_a_copy_that_ends_says_how_and_how_far_it_was(ends, said):
    def work(report):
        report("flight", 0.75)
        ends()

    answer, end, part = apart(work, LONG_S)

    assert answer is None
    assert end.split(" by ")[1] == said
    assert part == 0.75


def test_the_time_without_a_report_ends_a_copy_and_a_report_begins_it_anew():
    def work(report):
        for part in (0.2, 0.4, 0.6):  # longer than the silence, all together
            time.sleep(0.12)
            report("flight", part)
        time.sleep(LONG_S)

    began = time.monotonic()
    answer, end, part = apart(work, 0.25)

    assert answer is None
    assert end.startswith("made no progress")
    assert part == 0.6
    assert time.monotonic() - began < 0.1 * LONG_S
