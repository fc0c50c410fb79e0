"""A command at a terminal, in a pipe, on a full disk, and ended by a signal."""

import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
from commands import answer, flighttune

import flighttune as ft

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo terminal")

CAMPAIGN = """
title = "turns"
scenario = "turn.toml"
runs = {}
disperse = [{{ key = "flight.chi_deg", distribution = "uniform", lower = -5.0, upper = 5.0 }}]
keep = {{ failures = 0, worst = 0, sample = 0 }}
"""


@contextmanager
def watching(monkeypatch, until="", number=None):
    """Stderr as a pseudo terminal: what it shows, and a signal once it shows some words."""
    ours, theirs = os.openpty()
    shown = []

    def read():
        asked = number
        while True:
            try:
                shown.append(os.read(ours, 65536).decode(errors="replace"))
            except OSError:  # the other end is closed
                return
            if asked and until in "".join(shown):
                os.kill(os.getpid(), asked)
                asked = None

    reader = threading.Thread(target=read)
    reader.start()
    monkeypatch.setenv("TERM", "xterm")
    with os.fdopen(theirs, "w", encoding="utf-8") as stream:
        yield stream, shown
    reader.join()
    os.close(ours)


def at_a_terminal(monkeypatch, command, *, until="", number=None, status=0):
    with watching(monkeypatch, until, number) as (stream, shown):
        out, _ = flighttune(*command.split(), status=status, stderr=stream)
    return out, "".join(shown).replace("\r\n", "\n")


@pytest.fixture
def campaign(here):
    def made(runs):
        (here / "c.toml").write_text(CAMPAIGN.format(runs))
        return "campaign c.toml --workers 1 --out o"

    return made


def test_the_status_of_a_command_is_wiped_before_its_answer(here, monkeypatch):
    out, shown = at_a_terminal(monkeypatch, "trim aerosonde --V-a 25")
    (status,) = re.findall(r"^(\w[\w ]* \.\.\.)\r +\r$", shown)

    assert out
    assert re.search(r"\r +\r", shown)[0] == f"\r{' ' * len(status)}\r"
    assert at_a_terminal(monkeypatch, "trim aerosonde --V-a 25 -q") == ("", "")
    assert at_a_terminal(monkeypatch, "fly nowhere -q", status=2)[1].startswith("flighttune: ")
    assert at_a_terminal(monkeypatch, "list --json")[0] == flighttune("list", "--json")[0]


@pytest.mark.soak
def test_a_proof_shows_a_bar_with_the_share_that_is_done(here, monkeypatch):
    command = "tube small.toml --gains paper --start-deg 0.1 --out t.npz"

    _, shown = at_a_terminal(monkeypatch, command)

    shares = [int(x) for x in re.findall(r"(\d+)%", shown)]
    assert shares == sorted(shares)
    assert shares[-1] > 50
    assert flighttune(*command.split())[1] == ""


@pytest.mark.slow
def test_a_campaign_shows_its_runs_at_a_terminal_and_lines_in_a_pipe(campaign, monkeypatch):
    """A hangup that nohup ignores stays ignored meanwhile."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        _, shown = at_a_terminal(monkeypatch, campaign(4), until="of ", number=signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    _, told = flighttune(*campaign(4).replace("--out o", "--out p").split())

    assert "of 4 runs" in " ".join(shown.split())
    assert "of 4 runs" in told
    assert "\x1b" not in told
    assert len({line.partition(":")[0] for line in told.splitlines()}) == len(told.splitlines())


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_a_campaign_that_goes_on_later(campaign, monkeypatch, here, number):
    handler = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    before = signal.signal(number, handler)  # these tests may run under nohup
    try:
        _, shown = at_a_terminal(
            monkeypatch, campaign(4000), until="of ", number=number, status=130
        )
        assert signal.getsignal(number) == handler
    finally:
        signal.signal(number, before)

    assert re.search("flighttune: interrupted: .*resume|flighttune: .*--resume", shown)
    assert (here / "o" / "campaign.json").exists()


@pytest.mark.slow
def test_a_count_that_is_stopped_says_where_its_flights_are_kept(here, monkeypatch):
    few = "--start-deg 2 --epsilon 0.01 --confidence 0.9 --gains paper --workers 1"

    _, shown = at_a_terminal(
        monkeypatch, f"band turn.toml {few}", until="of ", number=signal.SIGINT, status=130
    )

    assert "flighttune: interrupted: " in shown
    assert not (here / "runs" / "turn-band.npz").exists()


# Where it lands in a listing of a folder, Python closes that late.
@pytest.mark.filterwarnings("ignore:unclosed scandir:ResourceWarning")
def test_ctrl_c_ends_a_command_that_keeps_nothing_with_130(here, monkeypatch):
    _, shown = at_a_terminal(
        monkeypatch, "tune paper --out g.json", until="...", number=signal.SIGINT, status=130
    )

    assert "Traceback" not in shown
    assert not (here / "g.json").exists()


@pytest.mark.parametrize(
    "title", ["\x1b[31mred\x07\x9b\u202e\u2028 end", "..", "at 25.5 m/s, etc.", "]]> -- <b>"]
)
def test_a_title_does_not_steer_the_terminal(here, title):
    text = (here / "turn.toml").read_text()
    (here / "own.toml").write_text(text.replace('"turn"', ft_text(title), 1))

    printed = flighttune("fly", "own.toml", "--out", "run")

    assert all(x.isprintable() or x in "\n\u00a0" for text in printed for x in text)
    assert answer("verify", "run")["equal"]


def ft_text(title):
    """A text of TOML."""
    return (
        '"'
        + "".join(x if x.isascii() and x.isprintable() else f"\\u{ord(x):04x}" for x in title)
        + '"'
    )


@pytest.mark.parametrize("word", ["x" * 5000, "\\u001b[2Jx", "a\\nb"])
def test_no_reason_is_longer_than_a_line_or_steers_the_terminal(here, word):
    (here / "own.toml").write_text(f'reference = {{ chi_deg = [{{ shape = "{word}" }}] }}')

    _, err = flighttune("fly", "own.toml", status=2)

    assert err.count("\n") == 1
    assert len(err) < 800
    assert err[:-1].isprintable()
    with pytest.raises(ft.InputError) as refusal:
        ft.load_scenario(here / "own.toml")
    assert str(refusal.value).isprintable()


def ended(*words, **streams):
    command = [sys.executable, "-m", "flighttune", *words]
    return subprocess.run(command, timeout=300, check=False, **streams)


@pytest.mark.soak
def test_a_pipe_that_nobody_reads_and_a_closed_output_are_no_failures_and_a_full_disk_is():
    nobody, pipe = os.pipe()
    os.close(nobody)
    done = ended("list", stdout=pipe, stderr=subprocess.PIPE)
    os.close(pipe)
    assert (done.returncode, done.stderr) == (0, b"")
    code = "import os, sys; os.close(1); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    closed = [sys.executable, "-c", code, "-m", "flighttune", "list"]
    done = subprocess.run(closed, stderr=subprocess.PIPE, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    if Path("/dev/full").exists():
        with open("/dev/full", "wb") as full:
            done = ended("list", stdout=full, stderr=subprocess.PIPE)
        assert done.returncode == 2
        assert re.fullmatch(rb"flighttune: standard output .*no space left.*\n", done.stderr)


@pytest.mark.soak
def test_an_encoding_may_lack_greek_letters():
    command = "compare", "paper_as_printed@paper", "paper_as_printed@K1"

    plain = ended(*command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONIOENCODING": "ascii"})

    lines = plain.stdout.decode("ascii").splitlines()
    assert plain.returncode == 0
    assert len(lines) == len(flighttune(*command)[0].splitlines()) > 2


@pytest.mark.counts
def test_a_campaign_goes_on_where_nobody_reads_its_progress(campaign, here):
    command = [sys.executable, "-m", "flighttune", *campaign(4).split()]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as running:
        running.stderr.close()

        assert running.wait(timeout=120.0) == 0

    assert len(ft.load(here / "o").rows()) == 4
