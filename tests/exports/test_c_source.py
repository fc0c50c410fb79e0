"""The outer loop in C, compiled by the system's compiler: the commands of `MimoPI`, to the bit."""

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from commands import answer

import flighttune as ft
from flighttune.exports.c_source import c_source, export_c
from flighttune.flight.models import gain_set

COMPILER = shutil.which("cc") or shutil.which("gcc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler is installed")

SAMPLES = 10_000
GAINS = ft.PIGains(
    K_P=np.array([[2.7, -0.31], [0.12, 3.3]]), K_I=np.array([[1.1, 0.07], [-0.05, 1.9]])
)
LIMITS = ft.Limits(
    lower=np.array([-0.8, -2.1]),
    upper=np.array([0.7, 2.2]),
    rate_lower=np.array([-0.5, -1.0]),
    rate_upper=np.array([0.6, 1.5]),
)
LAWS = {
    "as shipped": {"feed_forward": True},
    "back-calculation, scheduled": {"anti_windup": "back_calculation", "schedule_speed": 25.0},
    "no anti-windup": {"anti_windup": "none", "feed_forward": True},
    "no limits": {"limits": None, "feed_forward": True, "schedule_speed": 31.0},
}


class OuterLoop(ctypes.Structure):
    _fields_ = (
        ("u", ctypes.c_double * 2),
        ("integral", ctypes.c_double * 2),
        ("error", ctypes.c_double * 2),
        ("started", ctypes.c_int),
    )


def compiled(source, folder):
    """The library of a C file, built with every warning an error."""
    (folder / "loop.c").write_text(source)
    library = folder / "loop.so"
    strict = "-std=c99 -O2 -Wall -Wextra -Werror -pedantic -Wno-unused-parameter -shared -fPIC"
    command = [COMPILER, *strict.split(), str(folder / "loop.c"), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    loaded = ctypes.CDLL(str(library))
    loaded.ft_outer_loop_start.argtypes = [ctypes.POINTER(OuterLoop), *[ctypes.c_double] * 2]
    loaded.ft_outer_loop_step.argtypes = [ctypes.POINTER(OuterLoop), *[ctypes.c_double] * 6]
    loaded.ft_outer_loop_step_along.argtypes = [ctypes.POINTER(OuterLoop), *[ctypes.c_double] * 9]
    return loaded


def random_samples():
    """Rows of chi_ref, gamma_ref, chi, gamma, phi and V_a: errors of 1 mrad to several turns."""
    rng = np.random.default_rng(15)
    held = rng.uniform([-9.0, -1.2], [9.0, 1.2], size=(SAMPLES // 20, 2)).repeat(20, axis=0)
    # NumPy's cosine differs from the C library's in the last bit of some angles.
    same = np.array([float(np.cos(gamma)) == math.cos(gamma) for gamma in held[:, 1]])
    held[~same, 1] = 0.0
    spread = np.geomspace(1e-3, 3.0, SAMPLES)[rng.permutation(SAMPLES), None]
    flown = held + spread * rng.standard_normal((SAMPLES, 2))
    phi, V_a = rng.uniform([-1.3, 15.0], [1.3, 45.0], size=(SAMPLES, 2)).T
    return np.column_stack([held, flown, phi, V_a]).tolist()


@needs_compiler
@pytest.mark.parametrize("settings", LAWS.values(), ids=LAWS)
def test_the_c_file_commands_what_mimo_pi_does_to_the_bit(settings, tmp_path):
    law = ft.MimoPI(GAINS, dt=0.02, **{"limits": LIMITS, **settings})
    loop, state = compiled(c_source(law, title="a */ b", gains="c\nd"), tmp_path), OuterLoop()
    law.start(ft.FlightCondition(V_a=25.0, phi=0.1, n_z=0.9))
    loop.ft_outer_loop_start(state, 0.1, 0.9)
    limited = 0
    for chi_ref, gamma_ref, chi, gamma, phi, V_a in random_samples():
        measured = ft.Measured(chi, gamma, V_a, phi, 1.0, 100.0, (0.0, 0.0, 0.0), None)
        expected = law.step(measured, ft.ReferenceSample(chi_ref, gamma_ref, 0.0, 0.0), 0.0)

        loop.ft_outer_loop_step(state, chi_ref, gamma_ref, chi, gamma, phi, V_a)

        assert np.array([*state.u, *state.integral]).tobytes() == np.array(expected).tobytes()
        limited += any(law.state.limited)
    assert limited == 0 if settings.get("limits", LIMITS) is None else limited > SAMPLES / 2


@needs_compiler
def test_the_c_file_plans_roll_and_lift_for_the_rates_of_a_reference(tmp_path):
    """Expected: the law, given roll atan(chi' V / g) and lift cos(gamma) + gamma' V / g."""
    law, g = ft.MimoPI(GAINS, LIMITS, dt=0.02, feed_forward=True), 9.81
    source = c_source(law, title="t", gains="g", lead=(0.17, 0.19), g=g)
    loop, state = compiled(source, tmp_path), OuterLoop()
    law.start(ft.FlightCondition(V_a=25.0))
    loop.ft_outer_loop_start(state, 0.0, 1.0)
    rng = np.random.default_rng(3)
    for chi, gamma, phi in rng.uniform(-0.3, 0.3, (500, 3)).tolist():
        chi_rate, gamma_rate, V = 0.3 * chi, 0.2 * gamma, 31.0
        lift = math.cos(0.1) + gamma_rate * (V / g)
        planned = math.atan(chi_rate * (V / g)), lift / math.cos(phi)
        measured = ft.Measured(chi, gamma, 25.0, phi, 1.0, 100.0, (0.0, 0.0, 0.0), None)
        sample = ft.ReferenceSample(0.2, 0.1, chi_rate, gamma_rate, planned)
        expected = law.step(measured, sample, 0.0)

        loop.ft_outer_loop_step_along(
            state, 0.2, 0.1, chi_rate, gamma_rate, V, chi, gamma, phi, 25.0
        )
        assert [*state.u, *state.integral] == pytest.approx(list(expected), abs=1e-14)
    assert "FT_LEAD_PHI 0.17" in source


@needs_compiler
def test_the_file_of_a_scenario_has_the_tighter_limits_of_its_aircraft(tmp_path):
    scenario = ft.load_scenario("sensor_noise")  # rolls at 60 deg/s, its aircraft at 30
    source = export_c(scenario, "paper", gain_set(scenario, "paper"), tmp_path)
    loop, state = compiled(source.read_text(), tmp_path), OuterLoop()
    loop.ft_outer_loop_start(state, 0.0, 1.0)

    loop.ft_outer_loop_step(state, 1.0, 0.5, 0.0, 0.0, 0.0, 25.0)

    assert list(state.u) == pytest.approx([math.radians(30.0) / 50.0, 1.0 + 1.0 / 50.0])


@needs_compiler
def test_the_example_of_the_page_compiles_and_runs(tmp_path):
    page = (Path(__file__).parents[2] / "docs/export.md").read_text(encoding="utf-8")
    example = page.split("```c\n")[1].split("```")[0]
    answer("export", "paper", "--gains", "paper", "--format", "c", "--out", tmp_path)
    (tmp_path / "main.c").write_text(example)
    build = [COMPILER, "-std=c99", "-Wall", "-Werror", "main.c", "-o", "example", "-lm"]

    for command in (build, ["./example"]):
        subprocess.run(command, cwd=tmp_path, timeout=60, check=True)
