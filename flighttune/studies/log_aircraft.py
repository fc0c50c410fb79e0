"""An aircraft that its log describes: the lags identified from the log, if they can be checked."""

from collections.abc import Iterator, Mapping

from flighttune.base.errors import InputError
from flighttune.base.files.load import LOG, kind_of
from flighttune.logs.identify import NAMES, LogIdentification, identify
from flighttune.logs.log import Columns
from flighttune.vehicles.identification.identify import GOOD_FIT


def aircraft_of(
    aircraft: str | None, columns: Columns, assume: Mapping[str, float] | None
) -> tuple[str | None, list[str]]:
    """The aircraft to fly, and sentences on its lags if they are those of a log.

    The model of a log is written to ``runs/identified``. InputError if the log does not give one,
    or if no stretch that was not fitted confirms it.
    """
    if aircraft is None or kind_of(aircraft) != LOG:
        if assume:
            raise InputError("`assume` must be absent without the log of an aircraft.")
        return aircraft, []
    found = identify(aircraft, columns=columns, assume=assume)
    assert isinstance(found, LogIdentification)  # of a log
    for fault in _faults(found):
        raise InputError(f"{aircraft}: {fault}.")
    file = found.save()["model"]
    return str(file), [f"The lags of {aircraft} are in {file}. {' '.join(_words(found))}"]


def _faults(found: LogIdentification) -> Iterator[str]:
    """Why the lags of a log cannot be flown; none if those measured explain the log."""
    if found.missing:
        yield found.missing
    if not found.channels:
        yield "must show roll or load factor, got none: both are assumed"
    for name, channel in found.channels.items():
        if not channel.fit_percent >= GOOD_FIT:
            yield (
                f"a lag must explain {GOOD_FIT:g} % of {NAMES[name]} in stretches that were not "
                f"fitted, got {channel.fit_percent:.1f} %"
            )


def _words(found: LogIdentification) -> Iterator[str]:
    """How well each measured lag explains the log."""
    for name, channel in found.channels.items():
        lag, no_range = channel.lag, f"; no interval, as {channel.reason}" * bool(channel.reason)
        ends = "" if channel.frequency is None else " ({:.2f} to {:.2f})".format(*channel.frequency)
        yield (
            f"{NAMES[name].capitalize()}: order {lag.order}, {lag.natural_frequency:.3g} rad/s"
            f"{ends} behind {lag.delay:.2g} s explains {channel.fit_percent:.1f} % of the variance "
            f"in {channel.stretches} stretches, each not fitted when scored{no_range}."
        )
