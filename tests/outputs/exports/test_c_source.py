"""The outer loop in C, compiled by the system's compiler: the commands of `MimoPI`, to the bit."""

import ctypes
import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest
from commands import answer

import flighttune as ft
from flighttune.outputs.exports.export import c_source

COMPILER = shutil.which("cc") or shutil.which("gcc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler is installed")

SAMPLES = 3000
GAINS = ft.PIGains(
    K_P=np.array([[2.7, -0.31], [0.12, 3.3]]), K_I=np.array([[1.1, 0.07], [-0.05, 1.9]])
)
LIMITS = ft.loop.Limits(
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


def library(source, folder):
    """The library of a C file, built with every warning an error; each build has its own name."""
    file = folder / f"{uuid4().hex}.c"
    file.write_text(source)
    strict = "-std=c99 -O2 -Wall -Wextra -Werror -pedantic -Wno-unused-parameter -shared -fPIC"
    command = [COMPILER, *strict.split(), str(file), "-o", str(file.with_suffix(".so")), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(file.with_suffix(".so")))


class Loop:
    """A loop of a C file, and its state."""

    def __init__(self, source, folder, channels=2, *, exact=False):
        names = "u", "integral", "expected" if exact else "error"
        fields = [(name, ctypes.c_double * channels) for name in names]
        if not exact:
            fields.append(("started", ctypes.c_int))
        self._state = type("State", (ctypes.Structure,), {"_fields_": fields})()
        self._library = library(source, folder)

    def call(self, name, *values):
        """What a function of the file returns for numbers, and for a list of them as an array."""
        function = getattr(self._library, f"ft_outer_loop_{name}")
        function.restype = ctypes.c_double
        arrays = [
            (ctypes.c_double * len(x))(*x) if isinstance(x, list) else ctypes.c_double(x)
            for x in values
        ]
        return function(ctypes.byref(self._state), *arrays)

    @property
    def answer(self):
        """Commands and integrals."""
        return [*self._state.u, *self._state.integral]


def to_the_bit(answer, expected):
    return np.array(answer).tobytes() == np.array(expected).tobytes()


def measured(chi, gamma, phi, V_a=25.0, n_z=1.0, wind=None, **more):
    return ft.loop.Measured(chi, gamma, V_a, phi, n_z, 100.0, (0.0, 0.0, 0.0), wind, **more)


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
@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(x, id=i, marks=[pytest.mark.counts] * i.startswith("no "))
        for i, x in LAWS.items()
    ],
)
def test_the_c_file_commands_what_mimo_pi_does_to_the_bit(settings, tmp_path):
    law = ft.loop.MimoPI(GAINS, dt=0.02, **{"limits": LIMITS, **settings})
    loop = Loop(c_source(law, title="a */ b", gains="c\nd"), tmp_path)
    law.start(ft.loop.FlightCondition(V_a=25.0, phi=0.1, n_z=0.9))
    loop.call("start", 0.1, 0.9)
    limited = 0
    for chi_ref, gamma_ref, *state in random_samples():
        sample = ft.loop.ReferenceSample(chi_ref, gamma_ref, 0.0, 0.0)
        expected = law.step(measured(*state), sample, 0.0)

        loop.call("step", chi_ref, gamma_ref, *state)

        assert to_the_bit(loop.answer, expected)
        limited += any(law.state.limited)
    assert limited == 0 if settings.get("limits", LIMITS) is None else limited > SAMPLES / 2


@needs_compiler
def test_the_c_file_plans_roll_and_lift_for_the_rates_of_a_reference(tmp_path):
    """Expected: the law, given roll atan(chi' V / g) and lift cos(gamma) + gamma' V / g."""
    law, g = ft.loop.MimoPI(GAINS, LIMITS, dt=0.02, feed_forward=True), 9.81
    source = c_source(law, title="t", gains="g", lead=(0.17, 0.19), g=g)
    loop = Loop(source, tmp_path)
    law.start(ft.loop.FlightCondition(V_a=25.0))
    loop.call("start", 0.0, 1.0)
    rng = np.random.default_rng(3)
    for chi, gamma, phi in rng.uniform(-0.3, 0.3, (500, 3)).tolist():
        chi_rate, gamma_rate, V = 0.3 * chi, 0.2 * gamma, 31.0
        lift = math.cos(0.1) + gamma_rate * (V / g)
        planned = math.atan(chi_rate * (V / g)), lift / math.cos(phi)
        sample = ft.loop.ReferenceSample(0.2, 0.1, chi_rate, gamma_rate, planned)
        expected = law.step(measured(chi, gamma, phi), sample, 0.0)

        loop.call("step_along", 0.2, 0.1, chi_rate, gamma_rate, V, chi, gamma, phi, 25.0)

        assert loop.answer == pytest.approx(list(expected), abs=1e-14)
    assert "FT_LEAD_PHI 0.17" in source


@pytest.mark.soak
@needs_compiler
@pytest.mark.parametrize(
    "wind", [{}, {"wind": {"speed_mps": 6.0, "from_deg": 40.0, "down_mps": 2.0}}]
)
@pytest.mark.parametrize(
    "name", ["climb_beyond_power", pytest.param("engine_fails_in_climb", marks=pytest.mark.counts)]
)
def test_the_c_file_flies_the_airspeed_and_its_priority_as_fly_does(name, wind, tmp_path):
    """The file is given the signals of a flight in which the path angle gives way."""
    scenario = ft.scenario_from(ft.load_scenario(name).as_dict() | wind)
    gains = "tuned_identified"
    run = ft.fly(scenario, gains)[f"{scenario.plant[0].label} / {gains}"]
    source = ft.export(scenario, gains, out=tmp_path, form="c").source
    loop = Loop(source.read_text(), tmp_path, channels=3)
    loop.call("start", 0.0, *run.signals[["n_z", "n_x"]].iloc[0])
    given = [f"{x}_ref" for x in ("chi", "gamma", "V")]
    given += ["chi", "gamma", "phi", "V_a", "n_x_min", "n_x_max"]
    given += ["wind_north", "wind_east", "wind_down"]
    channels = "phi", "n_z", "n_x"
    wanted = ["gamma_given", *(f"{x}_cmd" for x in channels), *(f"{x}_integral" for x in channels)]
    worst, cut = 0.0, 0
    for row in run.signals[[*given, *wanted]].to_numpy().tolist():
        references, seen, expected = row[:3], row[3:12], row[12:]

        asked = loop.call("step", [*references, 0.0, 0.0, 0.0, seen[3], *seen])

        both = zip([asked, *loop.answer], expected, strict=True)
        worst = max(worst, *(abs(a - b) for a, b in both))
        cut += asked < references[1]
    assert worst < 1e-9
    assert cut > 100


@needs_compiler
def test_the_file_of_a_scenario_has_the_tighter_limits_of_its_aircraft(tmp_path):
    scenario = ft.load_scenario("sensor_noise")  # rolls at 60 deg/s, its aircraft at 30
    source = ft.export(scenario, "paper", out=tmp_path, form="c").source
    loop = Loop(source.read_text(), tmp_path)
    loop.call("start", 0.0, 1.0)

    loop.call("step", 1.0, 0.5, 0.0, 0.0, 0.0, 25.0)

    assert loop.answer[:2] == pytest.approx([math.radians(30.0) / 50.0, 1.0 + 1.0 / 50.0])


@needs_compiler
def test_the_example_of_the_page_compiles_and_runs(tmp_path):
    page = (Path(__file__).parents[3] / "docs/export.md").read_text(encoding="utf-8")
    example = page.split("```c\n")[1].split("```")[0]
    answer("export", "paper", "--gains", "paper", "--format", "c", "--out", tmp_path)
    (tmp_path / "main.c").write_text(example)
    build = [COMPILER, "-std=c99", "-Wall", "-Werror", "main.c", "-o", "example", "-lm"]

    for command in (build, ["./example"]):
        subprocess.run(command, cwd=tmp_path, timeout=60, check=True)


@pytest.mark.soak
@needs_compiler
@pytest.mark.parametrize("anti_windup", ["conditional", "back_calculation", "none"])
@pytest.mark.parametrize(
    "feedback", [(0.5, 0.3), pytest.param((0.0, 0.0), marks=pytest.mark.counts)]
)
@pytest.mark.parametrize("priority", ["gamma", "chi"])
def test_the_c_file_of_the_exact_law_commands_what_it_does(
    priority, feedback, anti_windup, tmp_path
):
    """Errors of a milliradian to several turns, at limits, brakes and the floor of lift."""
    gains = ft.PIGains(
        K_P=GAINS.K_P, K_I=GAINS.K_I, inputs=("chi_dot", "gamma_dot"), feedback=feedback
    )
    # Rate limits that seldom hold, so that ranges, brakes and none do too.
    limits = replace(
        LIMITS, rate_lower=50.0 * LIMITS.rate_lower, rate_upper=50.0 * LIMITS.rate_upper
    )
    law = ft.loop.ExactLaw(
        gains, limits, dt=0.02, anti_windup=anti_windup, priority=priority, lift_floor=0.3
    )
    loop = Loop(c_source(law, title="t", gains="g"), tmp_path, exact=True)
    law.start(ft.loop.FlightCondition(V_a=25.0, phi=0.1, n_z=0.9))
    loop.call("start", 0.1, 0.9)
    rng, kinds = np.random.default_rng(41), set()
    rates = rng.uniform(-0.4, 0.4, (SAMPLES, 2)).tolist()
    loads = rng.uniform(-1.5, 2.0, SAMPLES).tolist()
    rows = zip(random_samples(), rates, loads, strict=True)
    for (chi_ref, gamma_ref, chi, gamma, phi, V), (chi_rate, gamma_rate), n_z in rows:
        sample = ft.loop.ReferenceSample(chi_ref, gamma_ref, chi_rate, gamma_rate)
        expected = law.step(measured(chi, gamma, phi, V, n_z), sample, 0.0)

        loop.call("step", [chi_ref, gamma_ref, chi_rate, gamma_rate, chi, gamma, phi, n_z, V])

        assert to_the_bit(loop.answer, expected)
        kinds.add(tuple(law.state.limited))
    assert len(kinds) > 4, kinds


@needs_compiler
@pytest.mark.parametrize("law", ["exact", "paper"])
def test_the_c_file_of_two_channels_gives_a_path_angle_way_to_the_airspeed(law, tmp_path):
    """Expected: the path angle over ground of the bound through the air, by vectors."""
    tables = ft.load_scenario("level_turn").as_dict() | {"law": [law], "gains": ["paper"]}
    tables["controller"]["speed_priority"] = True
    tables["expect"], name = [], "paper" if law == "paper" else "exact:paper"
    source = ft.export(ft.scenario_from(tables), name, out=tmp_path, form="c").source
    given = library(source.read_text(), tmp_path).ft_path_angle
    given.restype, rng, cut = ctypes.c_double, np.random.default_rng(82), 0
    for _ in range(500):
        V_a, n_x, chi, gamma_ref = rng.uniform([18.0, -0.2, -3.0, -0.4], [30.0, 0.2, 3.0, 0.4])
        wind = rng.uniform(-6.0, 6.0, 3)
        numbers = map(ctypes.c_double, (gamma_ref, 25.0, chi, V_a, n_x))

        angle = given(*numbers, (ctypes.c_double * 3)(*wind))

        sine = n_x + 1.5 / 25.0 * (V_a - 0.875 * 25.0)
        across = wind[1] * math.cos(chi) - wind[0] * math.sin(chi)
        along = wind[0] * math.cos(chi) + wind[1] * math.sin(chi)
        forward = along + math.sqrt(V_a**2 * (1.0 - sine**2) - across**2)
        steepest = math.atan2(V_a * sine - wind[2], forward)
        assert angle == pytest.approx(min(gamma_ref, steepest), abs=1e-12)
        cut += angle < gamma_ref
    assert 100 < cut < 400
    without = ft.export("level_turn", name, out=tmp_path / "without", form="c").source
    assert "double ft_path_angle(" not in without.read_text()


def test_the_exact_law_with_an_airspeed_has_no_c_file(tmp_path):
    scenario = ft.load_scenario("climb_beyond_power", changes={"law": "exact"})
    name = "exact:tuned_identified"
    with pytest.raises(ft.InputError, match=r"`V_mps` .* must be absent"):
        ft.export(scenario, name, out=tmp_path, form="c")
