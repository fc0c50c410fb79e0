"""``[[expect]]`` of a scenario: the requirements for its runs."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from flighttune.base import quantities as q
from flighttune.base.files.table import abridged
from flighttune.flight import metrics
from flighttune.flight.loop.run import RunStatus
from flighttune.vehicles.plants.base import goes_by

Subject: TypeAlias = Literal["chi", "gamma", "V", "flight", "loop", "cross_track", "height_err"]

# Rows of time (s) and bound, of ``within``.
Row: TypeAlias = Annotated[list[q.NotNegative], Field(min_length=2, max_length=2)]

Within: TypeAlias = Annotated[list[Row], Field(min_length=1, max_length=20)]

Bound: TypeAlias = Annotated[
    Annotated[q.Finite, Tag("number")] | Annotated[Within, Tag("rows")],
    Discriminator(lambda value: "rows" if isinstance(value, list) else "number"),
]

Bounds: TypeAlias = dict[Subject, dict[str, Bound]]

CHANNEL_MEASURES = (*metrics.METRICS, "peak_rad")

MEASURES_OF = {
    "flight": (*metrics.FLIGHT_METRICS,),
    "loop": (*metrics.LOOP_METRICS,),
    metrics.AIRSPEED: (*metrics.AIRSPEED_METRICS,),
    **dict.fromkeys(metrics.OFF_ROUTE, ()),
}


class ExpectTable(q.Table):
    """Requirements for the runs of one plant, of one gain set, of both, or for all runs.

    Bounds are grouped by ``chi``, ``gamma`` (measures of the channel, and ``peak_rad``, the largest
    error), ``V`` (the same of an airspeed that is followed, in m/s, and its lowest value
    ``min_mps``), ``flight`` and ``loop`` (indicators and margins on the model of ``[tuning]``); a
    measure in rad may be given in deg under that ending, one in rad/s under ``_dps``. ``band_deg``
    beside ``settling_s`` is the error within which a response counts as settled, in place of 5 % of
    the commanded change. ``at_most.chi.within = [[0, 90], [4, 6], [6, 1]]`` is an envelope of the
    error over time: 90 deg, 6 deg from 4 s and 1 deg from 6 s after the end of a change (``gamma``
    likewise, ``V`` in m/s, and on a route ``cross_track`` and ``height_err`` in m, from the start);
    the largest ratio of error to envelope must be at most 1. Bounds include that a flight follows
    its reference to the end.
    """

    plant: Annotated[str, Field(min_length=1)] | None = None  # a label, or a whole kind
    gains: Annotated[str, Field(min_length=1)] | None = None  # all if left out
    status: RunStatus | None = None  # completed if left out
    at_most: Bounds = Field(default_factory=dict)  # bounds by channel, flight or loop, and measure
    at_least: Bounds = Field(default_factory=dict)  # likewise

    @model_validator(mode="after")
    def _measures_exist(self) -> "ExpectTable":
        if not (self.status or self.at_most or self.at_least):
            raise ValueError("`status`, `at_most` or `at_least` must be given")
        for sense, bounds in (("at_most", self.at_most), ("at_least", self.at_least)):
            for subject, limits in bounds.items():
                measures = MEASURES_OF.get(subject, CHANNEL_MEASURES)
                for name, bound in limits.items():
                    if name == "within":
                        _check_envelope(subject, sense, bound)
                    elif isinstance(bound, list):
                        raise ValueError(f"`{subject}.{name}` must be a number, got {bound}")
                    elif name == "band_deg":
                        if "settling_s" in limits and subject in metrics.CHANNELS and bound > 0.0:
                            continue
                        raise ValueError(
                            f"`{subject}.band_deg` must be positive and beside `settling_s` of a "
                            f"channel, got {bound:g}"
                        )
                    elif in_rad(name) not in measures:
                        raise ValueError(
                            f"`{subject}.{name}` must be one of {', '.join((*measures, 'within'))} "
                            "(or _deg in place of _rad)"
                        )
                    elif sense == "at_most" and bound < 0.0 and in_rad(name) not in metrics.SIGNED:
                        raise ValueError(f"`{subject}.{name}` must be at least 0, got {bound:g}")
        return self

    def meant(self, plant: str, gains: str) -> bool:
        """Whether the requirements apply to runs of this plant and these gains."""
        return goes_by(plant, self.plant) and self.gains in (None, gains)


def _check_envelope(subject: str, sense: str, rows: Any) -> None:
    if sense == "at_least" or subject not in metrics.ENVELOPES:
        raise ValueError(f"`within` must be under at_most.{' or '.join(metrics.ENVELOPES)}")
    times, bounds = zip(*rows, strict=True) if isinstance(rows, list) else ((), (0.0,))
    if [*times] != [0.0, *sorted({*times} - {0.0})] or min(bounds) <= 0.0:
        raise ValueError(
            f"`{subject}.within` must be rows of time [s] and bound, times rising from 0 and "
            f"bounds positive, got {abridged(rows)}"
        )


def in_rad(measure: str) -> str:
    """Name of a measure with ``_deg`` replaced by ``_rad``, and ``_dps`` by ``_rad_s``."""
    for ending, si in (("_deg", "_rad"), ("_dps", "_rad_s")):
        if measure.endswith(ending):
            return measure.removesuffix(ending) + si
    return measure
