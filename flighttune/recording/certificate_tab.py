"""The tab that holds flights against the guarantees of their gains."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.arrays import FloatArray
from flighttune.palette import LIMIT, NEUTRAL, rgb
from flighttune.recording.cast import Member
from flighttune.recording.certified import Certified
from flighttune.recording.lanes import log_timeline, runs_of_equal
from flighttune.recording.names import CLAIMS, GUARANTEE, plain_name, times
from flighttune.recording.thinning import peaks

TAB = "Certificate"
HOLDS, NO_CLAIM, BROKEN = 0, 1, 2
WORDS = {HOLDS: "holds", NO_CLAIM: "no claim", BROKEN: "broken"}
SMALLEST = 1e-6
"""Sizes below are drawn as this: rounding."""

DECADES = 4.5
"""Most that are shown at first; a run that stands on its reference goes down for ever."""

FAINT = 130
ROOM = 0.04


def log_certificates(
    stream: rr.RecordingStream, members: Sequence[Member], claims: Mapping[str, Certified]
) -> None:
    """Log ``log10 ||s||`` of each run with its bound, and where the bound is broken.

    Parameters
    ----------
    stream : RecordingStream
    members : sequence of Member
    claims : mapping of str to Certified
        By key of the member; those without one are left out.
    """
    folders = _folders(members)
    for member in members:
        if member.key in claims:
            folder = folders[member.run.provenance.gains_name]
            _log_run(stream, member, claims[member.key], folder)
    styles: dict[str, tuple[str, tuple[int, ...]]] = {}
    lanes = []
    for member in members:
        if member.key not in claims:
            nothing = f"{member.key} nothing"
            styles[nothing] = (f"{member.run.label}: no certificate", rgb(NEUTRAL))
            lanes.append((np.array([0.0, member.run.duration]), [nothing, ""]))
            continue
        colours = {HOLDS: member.look.rgb, NO_CLAIM: rgb(NEUTRAL), BROKEN: rgb(LIMIT)}
        for state, word in WORDS.items():
            styles[f"{member.key} {word}"] = (f"{member.run.label}: {word}", colours[state])
        claim = claims[member.key]
        now = np.where(claim.broken, BROKEN, np.where(np.isnan(claim.bound), NO_CLAIM, HOLDS))
        t, states = runs_of_equal(claim.t, now)
        t[0] = 0.0
        words = [f"{member.key} {WORDS[state]}" for state in states.tolist()]
        lanes.append((np.append(t, member.run.duration), [*words, ""]))
    if lanes:
        log_timeline(stream, CLAIMS, lanes, styles)


def _folders(members: Sequence[Member]) -> dict[str, str]:
    """Where the lines of each gain set are."""
    names = dict.fromkeys(member.run.provenance.gains_name for member in members)
    return {name: f"{GUARANTEE}/{k:02d}_{plain_name(name)}" for k, name in enumerate(names)}


def _log_run(stream: rr.RecordingStream, member: Member, claim: Certified, folder: str) -> None:
    look, label = member.look, member.run.label
    t, drawn = claim.t, _logarithms(claim)
    kept = peaks(drawn)
    path = f"{folder}/{member.key}"
    style = rr.SeriesLines(
        colors=[(*look.rgb, 255), (*look.rgb, FAINT)],
        widths=[look.width, 1.2],
        names=[label, f"{label}, guaranteed"],
    )
    stream.log(path, style, static=True)
    when = times(pd.Index(t[kept]))
    stream.send_columns(path, [when], rr.Scalars.columns(scalars=drawn[kept]))
    path = f"{folder}/_{member.key}_ultimate"
    style = rr.SeriesLines(
        colors=[(*look.rgb, FAINT)], widths=[3.0], names=[f"{label}, ultimate bound"]
    )
    stream.log(path, style, static=True)
    ends = np.array([member.run.duration / 2.0, member.run.duration])
    level = np.full(2, np.log10(max(claim.radius, SMALLEST)))
    stream.send_columns(path, [times(pd.Index(ends))], rr.Scalars.columns(scalars=level))


def _logarithms(claim: Certified) -> FloatArray:
    return np.log10(np.maximum(np.column_stack([claim.size, claim.bound]), SMALLEST))


def certificate_tab(
    members: Sequence[Member], claims: Mapping[str, Certified]
) -> list[rrb.TimeSeriesView]:
    """A view for each gain set: all plants that flew it, over one range of decades."""
    sets: dict[str, list[Certified]] = {}
    for member in members:
        if member.key in claims:
            sets.setdefault(member.run.provenance.gains_name, []).append(claims[member.key])
    drawn = np.concatenate([_logarithms(claim).ravel() for claim in claims.values()])
    high = float(np.nanmax(drawn))
    low = max(float(np.nanmin(drawn)), high - DECADES)
    room = ROOM * max(high - low, 1.0)
    folders = _folders(members)
    return [
        rrb.TimeSeriesView(
            origin=folders[name],
            name=f"{name}: log10 |s|, guarantee thin, ultimate bound wide",
            axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
            axis_y=rrb.ScalarAxis(range=(low - room, high + room)),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name in sets
    ]
