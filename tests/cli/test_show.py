"""Progress on a terminal, and ends by a signal: what a user sees on stderr, and the exit status."""

import io
import os
import signal
import subprocess
import sys
from collections import Counter
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from flighttune.base.errors import FORKS, StoppedError
from flighttune.campaigns.engine.progress import CampaignProgress
from flighttune.cli import show
from flighttune.outputs.answers.answer import Answer
from flighttune.outputs.answers.finding import unmet

needs_terminals = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo terminal")


@contextmanager
def terminal():
    """Stderr as a pseudo terminal; a function that returns what has been written there."""
    ours, theirs = os.openpty()
    os.set_blocking(ours, False)

    def seen():
        stream.flush()
        parts = []
        while True:
            try:
                parts.append(os.read(ours, 65536))
            except BlockingIOError:
                return b"".join(parts).decode().replace("\r\n", "\n")

    with os.fdopen(theirs, "w", encoding="utf-8") as stream, redirect_stderr(stream):
        yield seen
    os.close(ours)


@needs_terminals
def test_the_status_of_a_command_is_wiped_before_its_next_line():
    stdout = io.StringIO()
    with terminal() as seen, redirect_stdout(stdout):
        with show.working("tuning", quiet=False):
            assert seen() == "tuning ..."
            show.say("found")
            assert seen() == f"\r{' ' * len('tuning ...')}\r"
            show.say("more")
            assert seen() == ""
        assert stdout.getvalue() == "found\nmore\n"
        with show.working("flying", quiet=False, as_json=True):
            show.say("recording: x.rrd")
        assert "recording: x.rrd\n" in seen()
    assert "x.rrd" not in stdout.getvalue()


@needs_terminals
def test_a_quiet_command_shows_no_status_and_no_bar():
    with terminal() as seen, show.working("tuning", quiet=True):
        assert not show.watched()
        with show.progress_bar() as update:
            assert update is None
        assert seen() == ""


@needs_terminals
def test_a_bar_names_what_is_done_and_its_share(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    with terminal() as seen, show.working("tube", quiet=False):
        with show.progress_bar() as update:
            update("tube", 0.25)
            update("tube", 0.5)
            update("again", 1.0)
        shown = seen()
    assert "tube" in shown
    assert "again" in shown
    assert "50%" in shown
    assert "100%" in shown


def campaign(**changes):
    return CampaignProgress(**{"doing": "flying", "runs": 40, **changes})


@needs_terminals
def test_a_campaign_shows_its_runs_and_sentences_on_a_terminal(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    with terminal() as seen, show.working("campaign", quiet=False):
        with show.campaign_display() as display:
            display.see(campaign(statuses=Counter(completed=30)))
            display.hear("a worker ended")
        shown = seen()
    assert "30 of 40 runs" in " ".join(shown.split())
    assert "a worker ended\n" in shown


def test_without_a_terminal_a_campaign_prints_a_line_for_each_activity_and_every_ten_seconds(
    monkeypatch,
):
    stderr, clock = io.StringIO(), [1000.0]
    monkeypatch.setattr(show.time, "monotonic", lambda: clock[0])
    with redirect_stderr(stderr), show.campaign_display() as display:
        for at, doing in (
            (0, "flying"),
            (5, "flying"),
            (9.9, "flying"),
            (10, "flying"),
            (11, "keeping"),
        ):
            clock[0] = 1000.0 + at
            display.see(campaign(doing=doing, statuses=Counter(completed=round(at))))
        display.hear("a sentence")
    lines = stderr.getvalue().splitlines()
    assert [line.partition(" runs")[0] for line in lines] == [
        "flying: 0 of 40", "flying: 10 of 40", "keeping: 11 of 40", "a sentence"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        (("runs/kept.jsonl",), "the same command goes on with the flights in runs/kept.jsonl"),
        ((), "its flights are not kept, and nothing is written"),
    ],
)
def test_a_stopped_campaign_says_what_is_kept_and_ends_with_130(kept, said):
    stderr, stopped = io.StringIO(), StoppedError("stopped")
    stopped.kept = kept
    with redirect_stderr(stderr), pytest.raises(SystemExit) as ended, show.campaign_display():
        raise stopped
    assert ended.value.code == 130
    assert stderr.getvalue() == f"flighttune: interrupted: {said}\n"


@pytest.mark.parametrize("number", show.SIGNALS)
def test_the_first_signal_stops_a_campaign_and_the_next_is_handled_as_before(number):
    before = signal.signal(number, lambda *_: asked.append("before"))
    asked = []
    try:
        with show.campaign_display() as display:
            assert not display.stopped
            signal.raise_signal(number)
            assert display.stopped
            assert asked == []
            signal.raise_signal(number)
            assert asked == ["before"]
        signal.raise_signal(number)
        assert asked == ["before"] * 2
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", show.SIGNALS)
def test_a_block_that_nothing_stops_is_interrupted_and_handlers_come_back(number):
    before, handler = signal.getsignal(number), lambda *_: None
    signal.signal(number, handler)
    try:
        with pytest.raises(KeyboardInterrupt), show.on_interrupt():
            signal.raise_signal(number)
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)


@pytest.mark.skipif(not FORKS, reason="there is no SIGHUP")
def test_a_hangup_that_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with show.on_interrupt():
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


# A block whose unfinished file is removed before a signal ends the process.
ENDED = """
import os, signal, sys
from pathlib import Path
from flighttune.cli.show import cleaning_up
file = Path(sys.argv[1])
with cleaning_up():
    file.write_text("unfinished")
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    finally:
        file.unlink()
print("not reached")
"""


@pytest.mark.slow
@pytest.mark.skipif(not FORKS, reason="a process does not end by a signal")
def test_a_process_that_is_ended_cleans_up_and_tells_its_parent_the_signal(tmp_path):
    command = [sys.executable, "-c", ENDED, str(tmp_path / "file")]

    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)

    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGTERM, "", "")
    assert not (tmp_path / "file").exists()


@pytest.mark.parametrize(
    ("failure", "source", "line"),
    [
        ("it is lost", "turn.toml", "turn.toml: it is lost"),
        ("turn.toml: it is lost", "turn.toml", "turn.toml: it is lost"),
        ("it is lost", Path("a/turn.toml"), "a/turn.toml: it is lost"),
        ("it is lost", "", "it is lost"),
        ("it is lost", None, "it is lost"),
        ("it is lost", 25.0, "it is lost"),
    ],
)
@pytest.mark.parametrize("status", [1, 2, 130])
def test_an_answer_that_fails_ends_with_its_status_and_names_the_source_once(
    failure, source, line, status
):
    stdout, stderr = io.StringIO(), io.StringIO()
    made = Answer(verdict="what was found", findings=unmet(failure, status))
    with (
        redirect_stdout(stdout),
        redirect_stderr(stderr),
        show.working("tuning", quiet=False),
        pytest.raises(SystemExit) as ended,
    ):
        show.emit(made, source)
    assert ended.value.code == status
    assert stderr.getvalue() == f"flighttune: {line}\n"
    assert stdout.getvalue().strip() == "What was found."


def test_an_answer_without_a_failure_does_not_exit_and_is_silent_if_quiet():
    stdout = io.StringIO()
    with redirect_stdout(stdout):
        with show.working("tuning", quiet=True):
            show.emit(Answer(verdict="more"))
        with show.working("tuning", quiet=True, as_json=True):
            show.emit(Answer(verdict="all"))
        with show.working("tuning", quiet=False):
            show.say("begun")
            show.emit(Answer(verdict="found", findings=unmet("")), "turn.toml")
    assert stdout.getvalue().startswith("{")
    assert stdout.getvalue().strip().endswith("}\nbegun\nfound.")
    assert "more" not in stdout.getvalue()


def test_a_long_reason_is_one_line_with_both_ends():
    stderr = io.StringIO()
    with redirect_stderr(stderr), pytest.raises(SystemExit) as ended:
        show.fail("begins\n " + "x" * 2000 + " ends", 2)
    (line,) = stderr.getvalue().splitlines()
    assert ended.value.code == 2
    assert line.startswith("flighttune: begins xxx")
    assert line.endswith("xxx ends")
    assert len(line) == len("flighttune: ") + show.MAX_REASON + len(" ... ")
    with redirect_stderr(stderr), pytest.raises(SystemExit):
        show.fail("x" * show.MAX_REASON, 1)
    assert stderr.getvalue().splitlines()[-1] == f"flighttune: {'x' * show.MAX_REASON}"
