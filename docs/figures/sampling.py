"""Draw docs/sampling.svg, what the controller's rate does: python docs/figures/sampling.py."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

import flighttune as ft
from flighttune.base.arrays import FloatArray, check_positive
from flighttune.base.errors import InputError, PlantError, ShapeError
from flighttune.base.units import DEG, G_0
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.linear_model import LinearModel
from flighttune.control.mimo_pi import MimoPI
from flighttune.flight.loop.loop import simulate
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, NEUTRAL
from flighttune.routes.segments import Reference
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.identification.file import design_model, load_identified
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant, steps_for

AIRCRAFT = "aerosonde"
V_A = 25.0

RATES = 10.0, 12.5, 16.0, 20.0, 25.0, 40.0, 50.0, 100.0
"""Controller rates, 1/s."""

STEP = 0.1 * DEG
"""Step of both references, rad: so small that no limit is met."""

SECONDS = 12.0

NEARLY_CONTINUOUS = 1e-3
"""Sample time, s, at which the loop with half a sample of delay is solved."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledStep:
    """One step of course and climb with one gain set at one controller rate.

    Attributes
    ----------
    rate : float, 1/s
        Of the controller.
    t : ndarray, shape (samples,), s
    flown, exact, delayed : ndarray, shape (samples, 2)
        Errors of course and climb over the step: on the aircraft; of the sampled controller on the
        identified model; of the continuous controller on the same behind half a sample of delay.
    damping : float, 1
        Smallest damping ratio of the sampled loop on the model.
    """

    rate: float
    t: FloatArray
    flown: FloatArray
    exact: FloatArray
    delayed: FloatArray
    damping: float


def sampled_step(
    aircraft: str, gains: PIGains, rate: float, *, V_a: float, h: float = 1000.0
) -> SampledStep:
    """Fly a small step from level flight at a controller rate, and predict it.

    Parameters
    ----------
    aircraft : str
        Name of an aircraft with an identified model.
    gains : PIGains
    rate : float, 1/s
        Of the controller.
    V_a, h : float, m/s and m
        Airspeed and height.

    Returns
    -------
    SampledStep

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft or model, or `rate` is not positive.
    TrimError
        If there is no steady flight.
    PlantError
        If the flight ended early.
    """
    if not (math.isfinite(rate) and rate > 0.0):
        raise InputError(f"`rate` must be positive, got {rate}.")
    dt = 1.0 / rate
    signals, stop = simulate(
        JSBSimPlant(aircraft, steps=steps_for(load_aircraft(aircraft), rate)),
        MimoPI(gains, dt=dt, feed_forward=True),
        Reference(chi=STEP, gamma=STEP),
        condition=FlightCondition(V_a=V_a, h=h),
        duration=SECONDS,
    )
    if stop is not None:
        raise PlantError(f"{aircraft} at {rate:g} Hz: {stop.reason}")
    flown = signals[["chi_err", "gamma_err"]].to_numpy() / STEP
    condition = load_identified(aircraft).nearest(V_a, 0.0)
    model, late = (
        design_model(condition, g=G_0, V_a=V_a, gamma=0.0, hold=hold).model
        for hold in (0.0, 0.5 * dt)
    )
    return SampledStep(
        rate=rate,
        t=signals.index.to_numpy(dtype=float),
        flown=flown,
        exact=sampled_response(model, gains, dt, e_0=np.ones(2), samples=len(flown)),
        delayed=_at_samples(
            sampled_response(
                late,
                gains,
                NEARLY_CONTINUOUS,
                e_0=np.ones(2),
                samples=round(SECONDS / NEARLY_CONTINUOUS) + 1,
            ),
            signals.index.to_numpy(dtype=float),
        ),
        damping=_smallest_damping(sampled_eigenvalues(model, gains, dt)),
    )


def overshoot(errors: FloatArray) -> FloatArray:
    """Largest overshoot of each error, shape (2,), over the step: errors of shape (samples, 2)."""
    return np.maximum(0.0, -errors.min(axis=0))


def sampled_steps(
    aircraft: str, gain_sets: dict[str, PIGains], *, V_a: float, rates: Sequence[float] = RATES
) -> dict[str, tuple[SampledStep, ...]]:
    """`sampled_step` of every gain set at every rate.

    Parameters
    ----------
    aircraft : str
    gain_sets : dict of str to PIGains
        By name.
    V_a : float, m/s
    rates : sequence of float, 1/s

    Returns
    -------
    dict of str to tuple of SampledStep

    Raises
    ------
    InputError, ScenarioError, TrimError, PlantError
        As `sampled_step`.
    """
    return {
        name: tuple(sampled_step(aircraft, gains, rate, V_a=V_a) for rate in rates)
        for name, gains in gain_sets.items()
    }


def _at_samples(response: FloatArray, t: FloatArray) -> FloatArray:
    return response[np.round(t / NEARLY_CONTINUOUS).astype(int)]


def _smallest_damping(eigenvalues: np.ndarray) -> float:
    kept = eigenvalues[np.isfinite(eigenvalues)]
    return float(np.min(-np.real(kept) / np.abs(kept)))


CHANNELS = "course", "flight-path angle"


def sampling_figure(steps: Mapping[str, Sequence[SampledStep]], *, shown_s: float = 6.0) -> Sheet:
    """Overshoot over the rate, and the steps at the slowest and the fastest rate.

    Parameters
    ----------
    steps : mapping of str to sequence of SampledStep
        By gain set, rates rising.
    shown_s : float, s
        Length of the steps drawn.

    Returns
    -------
    Sheet
        One column a channel; not saved.
    """
    charts = [_over_rate(steps, channel) for channel in range(2)]
    for name, flown in steps.items():
        ends = flown[0], flown[-1]
        charts += [_in_time(name, ends, channel, shown_s) for channel in range(2)]
    return Sheet(charts=charts)


def _over_rate(steps: Mapping[str, Sequence[SampledStep]], channel: int) -> Chart:
    chart = Chart(
        title=f"Step of {CHANNELS[channel]}",
        x="rate of the controller [Hz]",
        y="overshoot [% of the step]",
        log="x",
        x_room=0.05,
        x_ticks=[(rate, f"{rate}") for rate in (10, 20, 50, 100)],
    )
    for (name, flown), ((colour, _), _) in zip(steps.items(), HUES, strict=False):
        rates = [step.rate for step in flown]
        looks = {"exact": (f"{name}: sampled loop", ""), "delayed": ("half a sample late", DASHED)}
        for kind, (words, dash) in looks.items():
            chart.line(rates, _overshoots(flown, kind, channel), colour, dash=dash, name=words)
        chart.points(rates, _overshoots(flown, "flown", channel), colour, name="flown")
    chart.y_range = 0.0, chart.y_ends()[1]
    return chart


def _overshoots(steps: Sequence[SampledStep], kind: str, channel: int) -> list[float]:
    return [100.0 * overshoot(getattr(step, kind))[channel] for step in steps]


def _in_time(name: str, steps: Sequence[SampledStep], channel: int, shown_s: float) -> Chart:
    chart = Chart(
        title=f"{name}: {CHANNELS[channel]}", y="response over the step [1]", x_range=(0.0, shown_s)
    )
    for step, ((colour, _), _) in zip(steps, (HUES[1], HUES[2]), strict=True):
        kept = step.t <= shown_s
        every = max(1, round(step.rate / 10.0))
        predicted, response = (1.0 - errors[kept, channel] for errors in (step.exact, step.flown))
        chart.line(step.t[kept], predicted, colour, name=f"{step.rate:g} Hz: sampled loop")
        chart.points(step.t[kept][::every], response[::every], colour, size=2.5, name="flown")
    chart.level(1.0, NEUTRAL, dash=DASHED)
    return chart


def gain_sets() -> dict[str, PIGains]:
    """Return the gains that are drawn, by name."""
    tuned = ft.tune("paper_identified", model="identified").gains
    if tuned is None:
        raise SystemExit("no gains were found")
    return {"paper": PAPER_GAINS, "tuned_identified": tuned}


def sampled_loop(model: LinearModel, gains: PIGains, dt: float) -> FloatArray:
    """One sample of the loop: ``(x, w)`` at the next sample from that at this one.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    gains : PIGains
        Gains whose channels are those of `model`.
    dt : float, s
        Sample time.

    Returns
    -------
    ndarray, shape (n + m, n + m)
        ``u = (K_P + K_I dt/2) e + w`` is held for a sample, and ``w`` grows by ``K_I dt e``: the
        trapezoidal integral of `flighttune.control.mimo_pi.MimoPI` without limits.

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`, or `dt` is not positive.

    Notes
    -----
    The model under a held input by the matrix exponential: K. J. Astrom and B. Wittenmark,
    *Computer-Controlled Systems*, 3rd ed., Prentice Hall 1997, section 2.3.
    """
    model.check_channels(gains)
    check_positive("s", dt=dt)
    n, m, _ = model.shape
    held = expm(np.block([[model.A, model.B], [np.zeros((m, n + m))]]) * dt)
    A, B = held[:n, :n], held[:n, n:]
    direct = (gains.K_P + 0.5 * dt * gains.K_I) @ model.C
    return np.block([[A + B @ direct, B], [dt * gains.K_I @ model.C, np.eye(m)]])


def sampled_eigenvalues(
    model: LinearModel, gains: PIGains, dt: float
) -> npt.NDArray[np.complex128]:
    """Eigenvalues (1/s) of a continuous loop that decays and turns like the sampled one.

    Parameters
    ----------
    model, gains, dt
        As `sampled_loop`.

    Returns
    -------
    ndarray of complex, shape (n + m,)
        ``log(z) / dt`` of the eigenvalues z, rightmost first; stable where all lie on the left.

    Raises
    ------
    InputError
        As `sampled_loop`.
    """
    z = np.asarray(np.linalg.eigvals(sampled_loop(model, gains, dt)), dtype=complex)
    with np.errstate(divide="ignore"):
        s = np.asarray(np.log(z) / dt, dtype=complex)
    return s[np.argsort(-np.real(s), kind="stable")]


def sampled_response(
    model: LinearModel, gains: PIGains, dt: float, *, e_0: npt.ArrayLike, samples: int
) -> FloatArray:
    """Errors at the samples after a step of the references.

    Parameters
    ----------
    model, gains, dt
        As `sampled_loop`; the first p states of `model` are the errors.
    e_0 : array_like, shape (p,)
        Errors at the first sample; everything else is at rest.
    samples : int
        Samples wanted.

    Returns
    -------
    ndarray, shape (samples, p)

    Raises
    ------
    InputError
        As `sampled_loop`.
    ShapeError
        If `e_0` is not one number an error.
    """
    n, _, p = model.shape
    step = sampled_loop(model, gains, dt)
    e = np.asarray(e_0, dtype=float)
    if e.shape != (p,):
        raise ShapeError(f"`e_0` must have shape ({p},), got {e.shape}.")
    state = np.zeros(len(step))
    state[:p] = e
    state[n:] = -0.5 * dt * gains.K_I @ e
    errors = np.empty((samples, p))
    for k in range(samples):
        errors[k] = model.C @ state[:n]
        state = step @ state
    return errors


if __name__ == "__main__":
    steps = sampled_steps(AIRCRAFT, gain_sets(), V_a=V_A)
    sampling_figure(steps).save(Path(__file__).parents[1] / "sampling.svg")
