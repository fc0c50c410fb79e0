"""How a process ended, on systems with signals and on Windows; work in a copy of one."""

import errno
import os
import sys
import threading

import pytest

from flighttune import processes
from flighttune.processes import crash_of, joined, meanwhile

linux = pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (0, ""),
        (3, ""),
        (-11, "SIGSEGV"),
        (-250, "signal 250"),
        (0xC0000005, "exception 0xC0000005"),  # access violation, as Windows numbers it
    ],
)
def test_a_crash_is_named(code, said):
    assert crash_of(code) == said


@pytest.mark.parametrize(
    ("system", "line"),
    [("posix", "fly '--root=C:/My Flights'"), ("nt", 'fly "--root=C:/My Flights"')],
)
def test_a_command_line_is_quoted_for_the_shell_of_the_system(system, line, monkeypatch):
    monkeypatch.setattr(os, "name", system)

    assert joined(["fly", "--root=C:/My Flights"]) == line


@pytest.fixture
def one_thread(monkeypatch):
    """Tests run beside threads of their own, which no work here waits for."""
    monkeypatch.setattr(processes.threading, "active_count", lambda: 1)


@linux
@pytest.mark.usefixtures("one_thread")
def test_the_result_is_that_of_another_process():
    with meanwhile(lambda: (os.getpid(), os.getppid())) as answer:
        worker, parent = answer()

    assert worker != os.getpid() == parent


@linux
@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize(
    "work", [lambda: os.getpid() and 1 / 0, lambda: os.getpid().missing], ids=["number", "name"]
)
def test_an_error_is_that_of_the_work(work):
    with pytest.raises((ZeroDivisionError, AttributeError)) as direct:
        work()

    with pytest.raises(direct.type, match=str(direct.value)), meanwhile(work) as answer:
        answer()


@linux
@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("end", [lambda: os._exit(1), threading.Lock], ids=["ends", "no pickle"])
def test_work_without_a_result_is_done_here(end):
    here = os.getpid()

    def work():
        return here if os.getpid() == here else end()

    with meanwhile(work) as answer:
        assert answer() == here


@linux
@pytest.mark.usefixtures("one_thread")
def test_a_copy_that_nobody_waits_for_is_ended(monkeypatch):
    copies, fork = [], os.fork
    monkeypatch.setattr(processes.os, "fork", lambda: copies.append(fork()) or copies[-1])

    with pytest.raises(KeyboardInterrupt), meanwhile(threading.Event().wait):
        raise KeyboardInterrupt

    with pytest.raises(ProcessLookupError):
        os.kill(copies[0], 0)


@linux
@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("lacks", ["fork", "pipe"])
def test_where_there_is_no_room_for_a_copy_the_work_is_done_here(lacks, monkeypatch):
    def full():
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(processes.os, lacks, full)

    with meanwhile(os.getpid) as answer:
        assert answer() == os.getpid()


def test_beside_other_threads_the_work_is_done_here(monkeypatch):
    monkeypatch.setattr(processes.threading, "active_count", lambda: 2)

    with meanwhile(os.getpid) as answer:
        assert answer() == os.getpid()
