"""While a command runs: a bar where someone watches, lines elsewhere; Ctrl-C, SIGTERM, SIGHUP."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from types import FrameType
from typing import TYPE_CHECKING, Any

from flighttune.campaign.engine.progress import CampaignObserver, CampaignProgress
from flighttune.cli.show import INTERRUPTED, clear, fail, quiet, tell, watched

if TYPE_CHECKING:
    from flighttune.campaign.engine.pool import WorkerPool

LINE_EVERY_S = 10.0

# Ctrl-C, the end that a system asks for, and that of the terminal.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None] | None]:
    """A bar on stderr where someone watches, nothing elsewhere."""
    if not watched():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    clear()
    with Progress(console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, Any] = {}

        def update(label: str, part: float) -> None:
            if label not in tasks:
                tasks[label] = bar.add_task(label, total=1.0)
            bar.update(tasks[label], completed=part)

        yield update


class CampaignDisplay(CampaignObserver):
    """Progress of a campaign on stderr, as lines without a `bar`; stops the campaign on request."""

    def __init__(self, bar: Any) -> None:
        self.stopped = False
        self._bar = bar
        self._task = None if bar is None else bar.add_task("starting", total=None)
        self._last_line_at = -LINE_EVERY_S
        self._doing = ""
        self._warned = False

    def see(self, progress: CampaignProgress) -> None:
        """Show how far the campaign is."""
        if progress.doing == "flying" and not progress.workers and not self._warned:
            self._warned = True
            self.hear("no worker is there yet; waiting for one")
        parts = [f"{progress.doing}: {progress.done} of {progress.runs} runs"]
        if progress.rate_per_s:
            parts.append(f"{rate(progress.rate_per_s)} a second")
        if progress.left_s is not None and progress.doing == "flying":
            parts.append(f"{duration(progress.left_s)} left")
        for count, what in ((progress.failed, "failed"), (progress.crashed, "crashed")):
            if count:
                parts.append(f"{count} {what}")
        now, new, text = time.monotonic(), progress.doing != self._doing, ", ".join(parts)
        self._doing = progress.doing
        if self._bar is not None:
            ends = {"completed": progress.done, "total": progress.runs}
            self._bar.update(self._task, description=text, refresh=new, **ends)
        elif not quiet() and (new or now >= self._last_line_at + LINE_EVERY_S):
            self._last_line_at = now
            tell(text)

    def hear(self, sentence: str) -> None:
        """Show a sentence."""
        if self._bar is not None:
            self._bar.console.print(sentence, markup=False, highlight=False)
        else:
            tell(sentence)

    def stop(self) -> None:
        """Ask the campaign to end; what is in flight is dropped, what is flown is kept."""
        self.stopped = True
        self.hear("stopping; what has been flown is kept")


@contextmanager
def campaign_display() -> Iterator[CampaignDisplay]:
    """Show the campaign of the block; the first Ctrl-C or SIGTERM stops it."""
    bar = None
    if watched():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        columns = BarColumn(), TextColumn("{task.description}")
        bar = Progress(*columns, console=Console(stderr=True), transient=True)
        clear()
    display = CampaignDisplay(bar)
    with on_interrupt(display.stop), bar or nullcontext():
        yield display


@contextmanager
def campaign_pool(workers: int | None, scheduler: str | None) -> "Iterator[WorkerPool]":
    """Workers for the block that show how far they are; Ctrl-C or SIGTERM stops them."""
    from flighttune.campaign.engine.pool import worker_pool
    from flighttune.campaign.stated_set import StoppedError

    with campaign_display() as observer, worker_pool(workers, scheduler, observer) as pool:
        try:
            yield pool
        except StoppedError:
            fail("interrupted, nothing is written", INTERRUPTED)


def rate(per_s: float) -> str:
    """A number a second, to three figures or whole."""
    return f"{per_s:.0f}" if per_s >= 100.0 else f"{per_s:.3g}"


def duration(seconds: float) -> str:
    """A time as one would say it: ``48 s``, ``12 min``, ``3.4 h``."""
    if seconds < 120.0:
        return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


@contextmanager
def on_interrupt(stop: Callable[[], object] | None = None) -> Iterator[None]:
    """Call `stop` at the first of `SIGNALS` in the block; without it, raise KeyboardInterrupt.

    With `stop`, later signals are handled as before the block. It is called from the signal
    handler: it only asks for the end, and returns at once. Shells start commands in the
    background with SIGINT ignored; in the block it is not.
    """
    before = {number: signal.getsignal(number) for number in SIGNALS}
    if before[signal.SIGHUP] == signal.SIG_IGN:  # nohup wants it to be ignored
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
