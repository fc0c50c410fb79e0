"""A command in a terminal: its output, its progress, and its end by Ctrl-C, SIGTERM or SIGHUP.

One JSON object, or tables and lines, are on stdout; progress and reasons are on stderr.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from shutil import get_terminal_size
from types import FrameType
from typing import Any, NoReturn

from flighttune.base.errors import FORKS, StoppedError, printable
from flighttune.base.files.code import NOTICE
from flighttune.base.files.whole import reason_of
from flighttune.base.words import listed
from flighttune.campaigns.engine.progress import CampaignObserver, CampaignProgress
from flighttune.outputs.answers.answer import Answer

FINE, NO, COULD_NOT_RUN, INTERRUPTED = 0, 1, 2, 130

# Width of a table in a file or pipe, characters.
PLAIN_WIDTH = 120

# Maximum length of a line about a failure, characters.
MAX_REASON = 680

LINE_EVERY_S = 10.0

# Ctrl-C, a request to end from the system, and the end of the terminal.
SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if FORKS else []))

_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)
_JSON: ContextVar[bool] = ContextVar("as_json", default=False)

# Status on the last line of a terminal's stderr until the next output.
_DOING: ContextVar[str] = ContextVar("doing", default="")


@contextmanager
def working(doing: str, *, quiet: bool, as_json: bool = False) -> Iterator[None]:
    """Show a status line on a terminal while the command runs, such as ``tuning ...``."""
    _QUIET.set(quiet)
    _JSON.set(as_json)
    # Once per file, and with -q too, because the file may come from somebody else.
    NOTICE.set(cache(lambda file: tell(f"runs the Python code of {file}")))
    if watched():
        _DOING.set(f"{doing} ...")
        print(_DOING.get(), end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        clear()


def watched() -> bool:
    """Whether to show progress: stderr is a terminal, and -q is absent."""
    return sys.stderr.isatty() and not quiet()


def quiet() -> bool:
    """Whether the command was given -q."""
    return _QUIET.get()


def clear() -> None:
    """Clear the status from the terminal before the next output."""
    if doing := _DOING.get():
        print(f"\r{' ' * len(doing)}\r", end="", file=sys.stderr, flush=True)
        _DOING.set("")


def emit(answer: Answer, source: object = "") -> None:
    """Print an answer, and exit if it has a failure, which names the source of the command."""
    show(answer)
    if answer.failure:
        place = f"{source}: " if isinstance(source, str | Path) and source else ""
        fail(f"{place}{answer.failure.removeprefix(place)}", answer.status)


def show(answer: Answer) -> None:
    """Print an answer: one JSON object with ``--json``, else its text."""
    with output():
        if _JSON.get():
            clear()
            print(answer.json())
        elif not quiet():
            for part in answer.text(get_terminal_size((PLAIN_WIDTH, 0)).columns):
                clear()  # making the text may take long
                print(printable(part))


@contextmanager
def output() -> Iterator[None]:
    """Write the block's output to stdout; a full disk ends the command, a closed pipe does not."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        # the rest cannot be written, and Python would complain again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return
        fail(f"standard output must be writable, got {reason_of(error)}.", COULD_NOT_RUN)


def say(line: str) -> None:
    """Print one line while a command still runs, with ``--json`` on stderr."""
    clear()
    stream = sys.stderr if _JSON.get() else sys.stdout
    print(printable(line), file=stream, flush=True)  # pipes get it at once


def tell(line: str) -> None:
    """Print one line on stderr at a terminal; a campaign continues without a terminal."""
    with suppress(BrokenPipeError):
        clear()
        print(printable(line), file=sys.stderr, flush=True)


def fail(reason: str, status: int) -> NoReturn:
    """Print the reason, cut to one line, on stderr and exit with `status`."""
    line = " ".join(reason.split())
    if len(line) > MAX_REASON:
        half = MAX_REASON // 2
        line = f"{line[:half]} ... {line[-half:]}"
    tell(f"flighttune: {line}")
    sys.exit(status)


def _bar(*, sentences: bool) -> Any:
    """A bar of Rich on stderr at a terminal, else a context of None."""
    if not watched():
        return nullcontext()
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    clear()
    columns = (BarColumn(), TextColumn("{task.description}")) if sentences else ()
    return Progress(*columns, console=Console(stderr=True), transient=True)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None] | None]:
    """A bar on stderr at a terminal, else nothing."""
    with _bar(sentences=False) as bar:
        tasks: dict[str, Any] = {}

        def update(label: str, part: float) -> None:
            if label not in tasks:
                tasks[label] = bar.add_task(printable(label), total=1.0)
            bar.update(tasks[label], completed=part)

        yield None if bar is None else update


class CampaignDisplay(CampaignObserver):
    """Progress of a campaign on stderr, as lines without a `bar`; stops the campaign on request."""

    def __init__(self, bar: Any) -> None:
        self.stopped = False
        self._bar = bar
        self._task = None if bar is None else bar.add_task("starting", total=None)
        self._last_line_at = -LINE_EVERY_S
        self._doing = ""

    def see(self, progress: CampaignProgress) -> None:
        """Show the progress of the campaign."""
        now, new, text = time.monotonic(), progress.doing != self._doing, progress.sentence
        self._doing = progress.doing
        if self._bar is not None:
            done, runs = progress.part
            self._bar.update(self._task, description=text, refresh=new, completed=done, total=runs)
        elif not quiet() and (new or now >= self._last_line_at + LINE_EVERY_S):
            self._last_line_at = now
            tell(text)

    def hear(self, sentence: str) -> None:
        """Show a sentence."""
        if self._bar is not None:
            self._bar.console.print(printable(sentence), markup=False, highlight=False)
        else:
            tell(sentence)

    def stop(self) -> None:
        """Request the end; a signal handler must not print, because stderr may be in use."""
        self.stopped = True


@contextmanager
def campaign_display() -> Iterator[CampaignDisplay]:
    """Show the campaign of the block; the first Ctrl-C or SIGTERM stops it."""
    with _bar(sentences=True) as bar:
        display = CampaignDisplay(bar)
        try:
            with on_interrupt(display.stop):
                yield display
        except StoppedError as stopped:
            said = "its flights are not kept, and nothing is written"
            if stopped.kept:
                said = f"the same command goes on with the flights in {listed(stopped.kept)}"
                said += "; the flights of this stage are not kept" * stopped.lost
            fail(f"interrupted: {said}", INTERRUPTED)


@contextmanager
def cleaning_up() -> Iterator[None]:
    """End the process by a SIGTERM or SIGHUP in the block after unfinished files are removed."""
    ended_by: list[int] = []
    default = [number for number in SIGNALS[1:] if signal.getsignal(number) == signal.SIG_DFL]

    def handle(number: int, frame: FrameType | None) -> None:
        ended_by.append(number)
        restore()  # a second signal ends the process at once
        signal.default_int_handler(number, frame)

    def restore() -> None:
        for number in default:
            signal.signal(number, signal.SIG_DFL)

    for number in default:
        signal.signal(number, handle)
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        if not ended_by:
            raise
    finally:
        restore()
    if ended_by:
        os.kill(os.getpid(), ended_by[0])  # the parent process learns the signal


@contextmanager
def on_interrupt(stop: Callable[[], object] | None = None) -> Iterator[None]:
    """Call `stop` at the first of `SIGNALS` in the block; without it, raise KeyboardInterrupt."""
    # Later signals are handled as before the block. As a signal handler, `stop` only requests the
    # end. Shells start background commands with SIGINT ignored; the block does not ignore it.
    before = {number: signal.getsignal(number) for number in SIGNALS}
    if FORKS and before[signal.SIGHUP] == signal.SIG_IGN:  # nohup ignores SIGHUP on purpose
        del before[signal.SIGHUP]

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def handle(number: int, frame: FrameType | None) -> None:
        if stop is None:
            signal.default_int_handler(number, frame)
        restore()
        stop()

    for number in before:
        signal.signal(number, handle)
    try:
        yield
    finally:
        restore()
