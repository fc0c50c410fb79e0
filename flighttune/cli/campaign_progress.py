"""A campaign as it is seen while it is flown: a bar where someone watches, lines elsewhere."""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

from flighttune.cli.show import tell

if TYPE_CHECKING:
    from flighttune.campaign.engine.progress import CampaignProgress

LINE_EVERY_S = 10.0


class CampaignOnlooker:
    """Tells on stderr how far a campaign is, and stops it when told to.

    Attributes
    ----------
    stopped : bool
        Whether the campaign shall stop.
    """

    def __init__(self) -> None:
        self.stopped = False
        self._bar: Any = None
        self._task: Any = None
        self._told_at = -LINE_EVERY_S
        self._doing = ""
        self._alone = False

    def see(self, progress: "CampaignProgress") -> None:
        """Show how far the campaign is."""
        if progress.doing == "flying" and not progress.workers and not self._alone:
            self._alone = True
            self.hear("no worker is there yet; waiting for one")
        new = progress.doing != self._doing
        self._doing = progress.doing
        if self._bar is not None:
            self._bar.update(
                self._task,
                description=progress.doing,
                completed=progress.done,
                total=progress.runs,
                text=", ".join(_parts(progress)),
                refresh=new,
            )
            return
        now = time.monotonic()
        if new or now >= self._told_at + LINE_EVERY_S:
            self._told_at = now
            there = f"{progress.doing}: {progress.done} of {progress.runs} runs"
            tell(", ".join([there, *_parts(progress)]))

    def hear(self, sentence: str) -> None:
        """Show a sentence."""
        if self._bar is not None:
            self._bar.console.print(sentence, markup=False, highlight=False)
        else:
            tell(sentence)

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show a bar during the block where stderr is a terminal."""
        if not sys.stderr.isatty():
            yield
            return
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[text]}"),
        )
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            self._bar, self._task = bar, bar.add_task("starting", total=None, text="")
            try:
                yield
            finally:
                self._bar = None

    @contextmanager
    def ends_at_ctrl_c(self) -> Iterator[None]:
        """Stop at the first Ctrl-C or SIGTERM of the block; a second one ends the command."""

        def handle(_number: int, _frame: FrameType | None) -> None:
            give_back()
            self.stopped = True
            self.hear("stopping; what has been flown is kept")

        def give_back() -> None:
            for number, handler in before.items():
                signal.signal(number, handler)

        numbers = (signal.SIGINT, signal.SIGTERM)
        before = {number: signal.getsignal(number) for number in numbers}
        for number in numbers:
            signal.signal(number, handle)
        try:
            yield
        finally:
            give_back()


def _parts(progress: "CampaignProgress") -> list[str]:
    parts = []
    if progress.rate_per_s:
        parts.append(f"{rate(progress.rate_per_s)} a second")
    if progress.left_s is not None and progress.doing == "flying":
        parts.append(f"{duration(progress.left_s)} left")
    if progress.failed:
        parts.append(f"{progress.failed} failed")
    if progress.crashed:
        parts.append(f"{progress.crashed} crashed")
    return parts


def rate(per_s: float) -> str:
    """A number a second, to three figures or whole."""
    return f"{per_s:.0f}" if per_s >= 100.0 else f"{per_s:.3g}"


def duration(seconds: float) -> str:
    """A time as one would say it: ``48 s``, ``12 min``, ``3.4 h``."""
    if seconds < 120.0:
        return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
