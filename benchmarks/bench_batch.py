"""Batched kinematic flights against python-control and against the single-run loop.

Run with ``python benchmarks/bench_batch.py``. Times are medians, wall and processor times of
one thread; other load on the machine disturbs the latter less. What python-control flies is the
same sampled loop, written as one discrete-time system with one Runge-Kutta step of the plant a
sample, so that both must give the same errors (`SAME`).

Two limits are printed as kept or not, by wall and by processor time: flights at least
`TIMES_AS_FAST` times as fast as python-control, and `MANY` flights in at most `SECONDS`. Other work
on the machine makes both worse, so the script exits with 1 only where the errors differ or
processor time misses a limit by more than 30 % (`SLACK`).
"""

import math
import os
import statistics
import subprocess
import sys
import tempfile
import time

import control
import numpy as np
import running

from flighttune.control.gains import PAPER_GAINS, paper_family
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import MimoPI
from flighttune.flight.loop.batch import SIGNALS, fly_sampled
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.flight.loop.loop import simulate
from flighttune.routes.segments import Reference
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.point_mass import PointMassPlant

DT, DURATION = 0.01, 20.0
T = np.arange(round(DURATION / DT) + 1) * DT
REF = np.array([0.0, math.pi / 12])
LOW, HIGH = np.array([-math.pi / 4, -2.1]), np.array([math.pi / 4, 2.1])
RATE = np.array([math.pi / 6, 1.0])
NEVER = np.full(2, math.inf)
RANGES = Limits(lower=LOW, upper=HIGH, rate_lower=-NEVER, rate_upper=NEVER)
PRINTED = Limits(lower=LOW, upper=HIGH, rate_lower=-RATE, rate_upper=RATE)
START = FlightCondition(V_a=25.0, chi=math.pi / 3, gamma=math.pi / 4, phi=math.pi / 3, n_z=1.0)
WAVES = Sinusoid(chi_amplitude=0.1, chi_omega=0.15, gamma_amplitude=0.1, gamma_omega=0.15)
FAMILY = paper_family()
TIMES_AS_FAST = 100.0
MANY, SECONDS = 10_000, 8.0
SLACK = 1.3
PART = 500
SAME = 1e-9  # rad
FIRST_CALL = """
import time
import numpy as np
from flighttune.control.controller import FlightCondition
from flighttune.control.gains import PAPER_GAINS
from flighttune.control.mimo_pi import MimoPI
from flighttune.flight.loop.batch import fly_sampled
from flighttune.flight.loop.disturbance import Sinusoid
law = MimoPI(PAPER_GAINS, dt=0.01)
started = time.perf_counter()
condition, still = FlightCondition(V_a=25.0), [Sinusoid()]
fly_sampled([law], [condition], np.zeros((1, 1, 2)), duration=0.1, disturbances=still)
print(f"  {time.perf_counter() - started:.2f} s")
"""


def timed(work, repeats):
    """Median wall and processor time of `work` in s, and what it returned."""
    walls, busy, result = [], [], None
    for _ in range(repeats):
        wall, processor = time.perf_counter(), time.process_time()
        result = work()
        walls.append(time.perf_counter() - wall)
        busy.append(time.process_time() - processor)
    return np.array([statistics.median(walls), statistics.median(busy)]), result


def batch(laws, duration, **more):
    """The flights of some laws from `START` under `WAVES`, in one batch."""
    N, ref = len(laws), REF[None, None]
    waves = [WAVES] * N
    return fly_sampled(laws, [START] * N, ref, duration=duration, disturbances=waves, **more)


def word(kept):
    """How a limit is printed."""
    return "PASS" if kept else "FAIL"


def control_loop(gains):
    """The sampled loop with ranges and without anti-windup in python-control; output: errors."""
    K_P, K_I_half, g_over_v = gains.K_P, gains.K_I * (0.5 * DT), 9.81 / 25.0

    def next_state(t, s, *_):
        x, e = s[:2], REF - s[:2]
        integral = s[2:4] + K_I_half @ (e + s[4:])
        phi, n_z = np.clip(K_P @ e + integral, LOW, HIGH)
        turn, lift = g_over_v * math.tan(phi), n_z * math.cos(phi)

        def rates(now, gamma):
            chi_dot = turn + 0.1 * math.sin(0.15 * now)
            return np.array(
                [chi_dot, g_over_v * (lift - math.cos(gamma)) + 0.1 * math.cos(0.15 * now)]
            )

        k_1 = rates(t, x[1])
        k_2 = rates(t + 0.5 * DT, x[1] + 0.5 * DT * k_1[1])
        k_3 = rates(t + 0.5 * DT, x[1] + 0.5 * DT * k_2[1])
        k_4 = rates(t + DT, x[1] + DT * k_3[1])
        return [*(x + DT / 6.0 * (k_1 + 2.0 * (k_2 + k_3) + k_4)), *integral, *e]

    def errors(_, s, *__):
        return REF - s[:2]

    return control.nlsys(next_state, errors, inputs=1, outputs=2, states=6, dt=DT)


def in_parts(flown, laws, *more):
    """Fly many in parts: the signals of all would take 2 GB."""
    for first in range(0, len(laws), PART):
        flown(laws[first : first + PART], *more)


def against_control(flights, repeats):
    """Time of python-control over that of the batch; return whether it missed a limit."""
    names = list(FAMILY)
    laws = [MimoPI(FAMILY[name], RANGES, dt=DT, anti_windup="none", wrapped=()) for name in names]
    many = [laws[i % len(laws)] for i in range(flights)]

    def flown(laws):
        return batch(laws, DURATION)

    cost, _ = timed(lambda: in_parts(flown, many), repeats)
    few = flown(laws)
    costs, worst = [], 0.0
    for i, name in enumerate(names):
        e_0 = REF - [START.chi, START.gamma]  # the integrator takes nothing at the first sample
        start = [START.chi, START.gamma, 0.0, 0.0, *-e_0]
        loop = control_loop(FAMILY[name])
        spent, response = timed(
            lambda loop=loop, start=start: control.input_output_response(
                loop, T, np.zeros_like(T), start
            ),
            repeats,
        )
        assert response is not None
        costs.append(spent)
        for j, signal in enumerate(("chi_err", "gamma_err")):
            worst = max(worst, np.abs(response.outputs[j] - few.signal(signal)[i]).max())
    alone = np.mean(costs, axis=0)
    wall, busy = alone / (cost / flights)
    print(f"python-control, the same loop: {alone[0] * 1e3:.1f} ms a flight")
    print(f"  {wall:.0f} times as long, {busy:.0f} times the processor time; at least", end="")
    print(f" {TIMES_AS_FAST:.0f}: wall {word(wall >= TIMES_AS_FAST)}", end="")
    print(f", processor {word(busy >= TIMES_AS_FAST)}")
    print(f"  errors differ by {worst:.1e} rad, at most {SAME:.0e}: {word(worst <= SAME)}")
    return busy < TIMES_AS_FAST / SLACK or worst > SAME


def against_single_run(flights, repeats):
    """Batched flights and their difference to the single-run loop; return whether too slow."""
    laws = [MimoPI(gains, PRINTED, dt=DT) for gains in FAMILY.values()]
    many = [laws[i % len(laws)] for i in range(flights)]

    batch(many, DT)
    cost, _ = timed(lambda: in_parts(batch, many, DURATION), repeats)
    wall, busy = cost * MANY / flights
    print(f"{flights} flights of 20 s at 100 Hz: {cost[0]:.2f} s wall, {cost[1]:.2f} s processor")
    print(f"  {cost[1] / flights / len(T) * 1e9:.0f} ns a sample")
    print(f"  {MANY} of them: {wall:.2f} s wall, {busy:.2f} s processor; at most", end="")
    print(f" {SECONDS:.0f} s: wall {word(wall <= SECONDS)}, processor {word(busy <= SECONDS)}")

    def alone():
        return simulate(
            PointMassPlant(turn="paper", disturbance=WAVES),
            MimoPI(PAPER_GAINS, PRINTED, dt=DT),
            Reference(chi=REF[0], gamma=REF[1]),
            condition=START,
            duration=DURATION,
        )

    (_, single), flight = timed(alone, repeats)
    assert flight is not None
    signals, _ = flight
    again = batch([MimoPI(PAPER_GAINS, PRINTED, dt=DT)], DURATION)
    difference = max(
        np.abs(again.signal(name)[0] - signals[name]).max() for name in SIGNALS if name in signals
    )
    ratio = single / cost[1] * flights
    print(f"  single-run loop {single * 1e3:.1f} ms: {ratio:.0f} times the processor time")
    print(f"  largest difference of any signal: {difference:.1e}")
    return busy > SECONDS * SLACK


def main():
    """Print all of it; return what the shell gets."""
    parser = running.options(__doc__)
    parser.add_argument("--flights", type=int, default=100 if running.QUICK else 10_000)
    parser.add_argument("--repeats", type=int, default=1 if running.QUICK else 3)
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ} if running.QUICK else {**os.environ, "NUMBA_CACHE_DIR": folder}
        for note in ("first call in a new installation:", "first call in a later process:"):
            print(note, flush=True)
            subprocess.run([sys.executable, "-c", FIRST_CALL], check=True, env=environment)
    slow = against_single_run(options.flights, options.repeats)
    outrun = against_control(options.flights, options.repeats)
    return int(slow or outrun)


if __name__ == "__main__":
    running.end(main)
