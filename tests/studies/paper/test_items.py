"""Figures, tables and claims of the paper against closed forms and an independent integrator."""

import math
import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import flighttune
from places import ROOT
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.linalg import solve_continuous_lyapunov
from scipy.stats import spearmanr

pytestmark = pytest.mark.slow

SAME_PATH = 1e-6
COMPUTED = 2e-4
WRITTEN = 1e-8  # relative: tables have nine digits
CORNER = 1e-5  # rad, of Simpson's rule across the corners of the commands
TURNS = 4  # samples inside which a command or an integral part turns
G_OVER_V, GAMMA_C = 9.81 / 25.0, math.pi / 12.0
K_P = np.array([[1.6968, 0.5906], [-0.5906, 1.9556]])
K_I = np.array([[3.4869, 0.1784], [-0.1784, 3.4869]])
EPSILON = {"K1": -4.0, "K2": -2.0, "K3": -1.0, "K*": 0.0, "K4": 0.5, "K5": 0.8, "K6": 1.0}
PRINTED = {
    "K1": (0.7742, 7.873), "K2": (0.6754, 6.057), "K3": (0.5913, 5.312), "K*": (0.4427, 4.9244),
    "K4": (0.3626, 5.207), "K5": (0.2849, 6.161), "K6": (0.2192, 8.258),
}  # fmt: skip
L_D, OMEGA_D = (0.1, 0.2, 0.3), (0.1, 0.15, 0.2)
DISTURBANCES = {
    f"d{3 * i + k + 1}": (size, omega)
    for i, size in enumerate(L_D)
    for k, omega in enumerate(OMEGA_D)
}
GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0
ITEMS = ("fig1", "gains", "fig2", "fig3", "table2", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10")


TABLE = Path(__file__).with_name("verdicts.txt").read_text("utf-8").splitlines()
VERDICTS = {name: row for name, *row in (line.split(" | ") for line in TABLE)}
LATER = {"converges-with-all-limits", "global-stabilisation", "overall-enhancement"}
"""Claims whose flights take seconds: with rate limits, without limits, and of an aircraft."""


@pytest.fixture(scope="module")
def made(make):
    """All items but the one whose flights take longest, and the claims that need no other."""
    return make(*ITEMS, *(x for x in VERDICTS if x not in LATER))


def loop(epsilon=0.0):
    """The linear loop: ``e' = A e - B u`` around a climb of 15 deg, ``u = K_P e + K_I xi``."""
    shift = epsilon * np.eye(2)
    A = np.diag([0.0, G_OVER_V * math.sin(GAMMA_C)])
    B = G_OVER_V * np.eye(2)
    K = [-B @ (K_P - shift), -B @ (K_I - shift)]
    return np.block([[A + K[0], K[1]], [np.eye(2), np.zeros((2, 2))]])


def independent(epsilon, amplitude, omega, t):
    """The paper's law with commands cut off at their ranges, by an implicit integrator."""
    shift = epsilon * np.eye(2)

    def rates(now, s):
        u = (K_P - shift) @ s[:2] + (K_I - shift) @ s[2:]
        phi, n_z = np.clip(u, [-math.pi / 4, -2.1], [math.pi / 4, 2.1])
        lift = n_z * math.cos(phi) - math.cos(GAMMA_C - s[1])
        return [
            -G_OVER_V * math.tan(phi) - amplitude * math.sin(omega * now),
            -G_OVER_V * lift - amplitude * math.cos(omega * now),
            *s[:2],
        ]

    start = [-math.pi / 3, math.pi / 12 - math.pi / 4, 0.0, 0.0]
    settings = {"t_eval": t, "rtol": 1e-11, "atol": 1e-12, "max_step": 0.02}
    return solve_ivp(rates, (0.0, t[-1]), start, "LSODA", **settings).y[:2]


@pytest.mark.soak
def test_the_eigenvalues_are_those_of_the_printed_loop_and_the_disturbance_is_a_wave(made):
    spectrum = np.linalg.eigvals(loop())
    found = made.table("fig2").to_numpy() @ [1.0, 1j]
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(spectrum), abs=1e-7)
    assert made.values["fig2"]["spectral_abscissa"] == pytest.approx(spectrum.real.max(), abs=1e-9)
    t, chi, gamma = made.table("fig2_b").to_numpy().T
    assert (t[0], t[-1]) == (0.0, 20.0)
    assert chi == pytest.approx(0.1 * np.sin(0.15 * t), abs=WRITTEN)
    assert gamma == pytest.approx(0.1 * np.cos(0.15 * t), abs=WRITTEN)


@pytest.mark.soak
def test_indicators_are_those_of_the_lyapunov_equation_and_as_printed_but_for_the_star(made):
    rows = made.table("table2").set_index("type")
    assert rows["epsilon"].to_dict() == EPSILON
    for name, (R_K, I_K) in PRINTED.items():
        A_K = loop(EPSILON[name])
        Q = solve_continuous_lyapunov(A_K.T, -np.eye(4))
        assert rows.loc[name, "R_K"] == pytest.approx(1.0 / np.linalg.eigvalsh(Q)[-1], rel=1e-7)
        abscissa = np.linalg.eigvals(A_K).real.max()
        assert rows.loc[name, "spectral_abscissa"] == pytest.approx(abscissa, rel=1e-7)
        assert rows.loc[name, ["R_K_printed", "I_K_printed"]].tolist() == [R_K, I_K]
        if name != "K*":
            assert rows.loc[name, "R_K"] == pytest.approx(R_K, abs=1e-4)
            assert rows.loc[name, "I_K"] == pytest.approx(I_K, abs=1.5e-3)
        assert made.values["table2"][name]["I_K"] == pytest.approx(rows.loc[name, "I_K"])
    assert rows.loc["K*", "I_K"] == pytest.approx(4.91615, rel=COMPUTED)


@pytest.mark.parametrize(
    ("item", "name", "epsilon", "size", "omega"),
    [
        ("fig5", "K*", 0.0, 0.1, 0.15),
        ("fig5", "K6", 1.0, 0.1, 0.15),
        pytest.param("fig5", "K1", -4.0, 0.1, 0.15, marks=pytest.mark.soak),
        pytest.param("fig9", "d9", 0.0, 0.3, 0.2, marks=pytest.mark.soak),
    ],
)
def test_a_flight_is_that_of_an_independent_integrator(made, item, name, epsilon, size, omega):
    rows = made.table(item)
    rows = rows[rows["t_s"] <= 20.0]
    expected = independent(epsilon, size, omega, rows["t_s"].to_numpy())
    for channel, errors in zip(("chi", "gamma"), expected, strict=True):
        found = rows[f"{name}_e_{channel}_rad"].to_numpy()
        assert np.abs(found - errors).max() < SAME_PATH
        smooth = rows["t_s"].between(12.0, 19.9).to_numpy()
        slope = np.gradient(found, 0.01)[smooth]
        rate = rows[f"{name}_e_{channel}_dot_radps"].to_numpy()[smooth]
        assert rate == pytest.approx(slope, abs=2e-4)


def test_measures_are_sums_over_the_errors_that_are_tabled(made):
    for item, names in (("fig5", EPSILON), ("fig9", DISTURBANCES)):
        rows = made.table(item)
        rows = rows[rows["t_s"] <= 20.0]
        measures = made.table(f"{item}_measures").set_index(["name", "channel"])
        t = rows["t_s"].to_numpy()
        for name in names:
            for channel in ("chi", "gamma"):
                e = rows[f"{name}_e_{channel}_rad"].to_numpy()
                rate = rows[f"{name}_e_{channel}_dot_radps"].to_numpy()
                found = measures.loc[(name, channel)]
                assert found["ITAE"] == pytest.approx(np.trapezoid(t * np.abs(e), t), rel=1e-6)
                assert found["MO_rad"] == pytest.approx(e.max(), rel=WRITTEN)
                assert found["PT_s"] == pytest.approx(t[e.argmax()])
                assert found["mean"] == pytest.approx(e.mean(), rel=1e-3, abs=1e-4)
                of_rate = measures.loc[(name, f"{channel}_dot")]
                assert of_rate["std"] == pytest.approx(rate.std(), rel=1e-3)
                assert of_rate["mean"] == pytest.approx(rate.mean(), rel=1e-2, abs=1e-4)
                s = measures.loc[(name, f"s_{channel}")]
                assert s["std"] > 0.0
                assert s["MO_rad"] == pytest.approx(np.hypot(e, rate).max(), rel=1e-6)
                assert s["ITAE"] == pytest.approx(np.trapezoid(t * np.hypot(e, rate), t), rel=1e-5)


def test_the_manoeuvre_keeps_the_law_of_the_paper_from_sample_to_sample(made):
    rows = made.table("fig3")
    e = rows[["e_chi_rad", "e_gamma_rad"]].to_numpy()
    u, v = (rows[[f"phi{x}_rad", f"n_z{x}"]].to_numpy() for x in ("", "_wanted"))
    part = cumulative_simpson(e @ K_I.T, dx=0.01, axis=0, initial=0.0)
    assert v == pytest.approx(e @ K_P.T + part, abs=CORNER)
    ends = np.array([math.pi / 4, 2.1])
    assert u == pytest.approx(np.clip(v, -ends, ends), abs=1e-8)
    assert (u != v).any()
    peak = made.values["fig3"]["chi"]
    assert peak["MO_rad"] == pytest.approx(e[:, 0].max(), rel=WRITTEN)
    assert peak["PT_s"] == pytest.approx(rows["t_s"][e[:, 0].argmax()])


def test_trends_are_ranks_and_spreads_those_of_the_tables(made):
    rows = made.table("fig6").set_index(["name", "channel"])
    R_K = made.table("table2").set_index("type")["R_K"]
    trends = made.values["fig6"]["rank_correlation_with_R_K"]
    for measure, by_channel in trends.items():
        for channel, trend in by_channel.items():
            of_sets = [rows.loc[(name, channel), measure] for name in R_K.index]
            constant = len({f"{x:.6g}" for x in of_sets}) == 1
            expected = 0.0 if constant else spearmanr(R_K, of_sets).statistic
            assert trend == pytest.approx(expected, abs=1e-12)
    for channel, spread in made.values["fig8"]["spread_of_mean_rates"].items():
        rows8 = made.table("fig8").set_index("channel")
        means = rows8.loc[channel, "mean"]
        assert spread == pytest.approx(means.max() - means.min(), rel=1e-6)
    assert {*made.table("fig7")["channel"]} == {"s_chi", "s_gamma"}
    late = made.table("fig9").query("t_s >= 20.0")
    ST = made.table("fig10").set_index(["name", "channel"])["ST_rad"]
    for name in DISTURBANCES:
        for channel in ("chi", "gamma"):
            most = late[f"{name}_e_{channel}_rad"].abs().max()
            found = made.values["fig9"][name][channel]["largest_after_20_s_rad"]
            assert found == pytest.approx(most, rel=WRITTEN)
    for channel, grown in made.values["fig10"]["largest_growth_of_ST_rad"].items():
        ends = [abs(ST[(f"d{k + 6}", channel)] - ST[(f"d{k}", channel)]) for k in (1, 2, 3)]
        assert grown == pytest.approx(max(ends), rel=1e-6)


def test_the_gains_are_compared_with_the_optimum_and_with_their_limits(made):
    found, rows = made.values["gains"], made.table("gains").set_index("gains")
    assert (found["R_K_printed"], found["I_K_printed"]) == PRINTED["K*"]
    assert (found["K_P"], found["K_I"]) == (K_P.tolist(), K_I.tolist())
    assert rows.loc["K*", ["K_P_12", "K_P_21", "K_I_22"]].tolist() == [0.5906, -0.5906, 3.4869]
    best, nearest = rows.iloc[1], rows.loc["smallest I_K within the input constraints"]
    assert rows.loc["K*", "R_K_1_per_s"] / best["R_K_1_per_s"] == pytest.approx(0.894934, rel=1e-3)
    assert best["I_K_s2"] == pytest.approx(4.9244, rel=COMPUTED)
    assert found["with_input_constraints"]["smallest_I_K"] == pytest.approx(67.1457, rel=COMPUTED)
    assert nearest["largest_use_of_a_limit"] < 1.0 + 1e-6
    # u(t_0) = K_P e_0 + 0.1 s K_I e_0 and its rate, with e_0 = -(pi / 3, pi / 6)
    e_0 = -np.array([math.pi / 3.0, math.pi / 6.0])
    use, rate = found["command_use"], K_I @ e_0
    first = K_P @ e_0 + 0.1 * rate
    for k, (name, end, per_s) in enumerate((("phi", math.pi / 4, math.pi / 6), ("n_z", 2.1, 1.0))):
        assert use[name] == pytest.approx({"value": first[k], "lower": -end, "upper": end})
        assert use[f"{name} rate"] == pytest.approx(
            {"value": rate[k], "lower": -per_s, "upper": per_s}
        )
    assert rows.loc["K*", "largest_use_of_a_limit"] == pytest.approx(-rate[0] / (math.pi / 6))


def oscillator(alpha, beta, delta):
    """Rates of the oscillator, and P of its Lyapunov equation at the origin in closed form."""
    p_12 = 0.5 / alpha
    p_22 = (1.0 + 2.0 * p_12) / (2.0 * delta)
    P = np.array([[alpha * p_22 + delta * p_12, p_12], [p_12, p_22]])

    def rates(x, push=0.0):
        return np.array([x[1], -delta * x[1] - alpha * x[0] - beta * x[0] ** 3 + push])

    return rates, P


def test_the_oscillator_moves_as_an_independent_integrator_has_it(made):
    rows, (rates, _) = made.table("fig1"), oscillator(0.5, 0.25, 1.5)
    t = rows["t_s"].to_numpy()
    for column, push in (("a_undisturbed", 0.0), ("a_constant_L_d", 2.5)):
        path = solve_ivp(
            lambda _, x, push=push: rates(x, push), (0.0, t[-1]), [1.5, 0.0],
            t_eval=t, rtol=1e-10, atol=1e-12,
        ).y  # fmt: skip
        speed = np.linalg.norm(rates(path), axis=0)
        assert rows[column].to_numpy() == pytest.approx(speed, abs=SAME_PATH), column
    x = np.array([1.5, 0.0])
    along = [np.linalg.norm(rates(x))]
    for _ in range(30):  # a push of 0.1 s has the sign of the speed
        push = 2.5 if x[1] > 0.0 else -2.5
        x = solve_ivp(
            lambda _, x, push=push: rates(x, push), (0.0, 0.1), x, rtol=1e-9, atol=1e-11
        ).y[:, -1]
        along.append(np.linalg.norm(rates(x)))
    at = np.isin(np.round(t, 6), np.round(np.arange(31) * 0.1, 6))
    assert rows["a_along_the_motion"][at].to_numpy() == pytest.approx(along, abs=1e-4)


def test_the_oscillator_has_the_bounds_of_the_theorem(made):
    found, times = made.values["fig1"], made.table("fig1")
    norm_J = math.sqrt((3.5 + math.sqrt(3.5**2 - 1.0)) / 2.0)
    edge = math.sqrt((1.0 + math.sqrt(2.0)) / 0.75)
    rate, radius = GOLDEN**-2, 2.0 * 2.5 * norm_J * GOLDEN**4 / GOLDEN**-2
    assert (found["R_f"], found["I_f"]) == pytest.approx((rate, radius), rel=1e-9)
    assert found["region_half_width"] == pytest.approx(edge, rel=1e-9)
    assert found["smooth_region"] == pytest.approx(1.0 / (math.sqrt(3.0) * GOLDEN), rel=1e-9)
    limit = radius + (1.59375 * GOLDEN - radius) * np.exp(-0.5 * rate * times["t_s"])
    assert times["a_bound"].to_numpy() == pytest.approx(limit, rel=WRITTEN)
    noise = [times[f"a_noise_{x}"] for x in ("smallest", "run_1", "largest")]
    assert (noise[0] <= noise[1]).all()
    assert (noise[1] <= noise[2]).all()
    assert (noise[2] < times["a_bound"]).all()
    strips = made.table("fig1_region")
    assert strips["R_f_1_per_s"][0] == pytest.approx(rate, rel=WRITTEN)
    assert strips["c"].iloc[-1] == pytest.approx(0.999 * edge, rel=WRITTEN)
    assert (np.diff(strips["epsilon"]) < 0.0).all()
    assert (np.diff(strips["I_f"]) > 0.0).all()
    assert (strips["epsilon"] > 0.0).all()
    cases = made.table("fig1_cd")
    assert cases["alpha"].tolist() == [0.2, 0.35, 0.5, 0.75, 1.0, 1.5]
    for case in cases.itertuples():
        assert (case.beta, case.delta) == (case.alpha / 2.0, 1.5)
        rates, P = oscillator(case.alpha, case.beta, case.delta)
        assert case.R_f == pytest.approx(1.0 / np.linalg.eigvalsh(P)[-1], rel=1e-8)
        first = times[f"b_mean_norm_f_alpha_{case.alpha:g}"]
        assert first[0] == pytest.approx(np.linalg.norm(rates(np.array([1.5, 0.0]))), rel=WRITTEN)
        assert case.mean == pytest.approx(first.mean(), rel=1e-6)


@pytest.mark.soak
def test_flights_under_all_limits_keep_the_law_of_each_reading(make):
    made = make("fig4", "eigenvalues")
    rows, values = made.table("fig4_rate_limits"), made.values["fig4"]["readings"]
    ends, most = np.array([math.pi / 4, 2.1]), np.array([math.pi / 6, 1.0])
    for reading, conditional in (
        ("ranges_and_rate_limits", False), ("with_rate_limits_and_anti-windup", True)
    ):  # fmt: skip
        own = {
            x: rows[f"{reading}_{x}"].to_numpy()
            for x in ("e_chi_rad", "e_gamma_rad", "phi_rad", "n_z", "phi_wanted_rad", "n_z_wanted")
        }
        e, u, v = (np.column_stack([*own.values()][k : k + 2]) for k in (0, 2, 4))
        assert u[0] == pytest.approx([math.pi / 3, 1.0])
        wanted = np.clip(v, -ends, ends)[1:] - u[:-1]
        off = np.abs(np.diff(u, axis=0) - np.clip(wanted, -most * 0.01, most * 0.01))
        assert (off > SAME_PATH).sum() <= 20 * TURNS
        part, follow = v - e @ K_P.T, cumulative_simpson(e @ K_I.T, dx=0.01, axis=0, initial=0.0)
        assert (np.abs(part - follow).max() > 0.01) is np.bool_(conditional)
        late = np.abs(e[rows["t_s"] >= 18.0]).max()
        assert values[reading.replace("_", " ")]["converged"] == (late < 0.05)


@pytest.mark.parametrize("name", ITEMS)
def test_an_item_has_figures_tables_and_a_text(made, name):
    (item,) = (x for x in made.answer["items"] if x["name"] == name)
    kinds = {file.rpartition(".")[2] for file in item["files"]}
    assert kinds == {"svg", "csv", "md"}
    for file in item["files"]:
        if file.endswith("svg"):
            root = ElementTree.parse(made.folder / file.rpartition("/")[2]).getroot()
            assert root.tag.endswith("svg")
    text = (made.folder / f"{name}.md").read_text("utf-8")
    assert text.startswith("# ")
    assert "## Parameters" in text
    assert "## Assumed" in text
    assert "{" not in text


def near(words):
    try:
        return pytest.approx(float(words), rel=COMPUTED, abs=1e-6)
    except ValueError:
        return words


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.soak] * (x in LATER)) for x in VERDICTS]
)
def test_a_claim_is_judged_by_what_was_computed(make, made, name):
    verdict, *computed = VERDICTS[name]

    claim = (make(name) if name in LATER else made).claims[name]

    assert claim["verdict"] == verdict
    if verdict == "not checkable":
        assert [*claim["computed"]] == ["missing"]
        return
    assert [*claim["computed"].values()] == [near(x) for x in computed]
    assert claim["expected"].keys() == claim["computed"].keys()
    holds = [_holds(claim["expected"][x], y) for x, y in claim["computed"].items()]
    if None not in holds:
        kind = {(True,): "reproduced", (False,): "not reproduced"}
        assert verdict == kind.get(tuple({*holds}), "partly")


def _holds(expected, computed):
    """Whether a number keeps a limit that is told as a sign and a number; None for other words."""
    found = re.fullmatch(r"([≤≥<>]) (-?[\d.e-]+)", str(expected))
    if not found or isinstance(computed, str):
        return None
    limit = float(found[2])
    if computed == pytest.approx(limit, rel=1e-3, abs=1e-6):  # what decides is no digit of these
        return None
    return computed <= limit if found[1] in "≤<" else computed >= limit


def test_the_claims_that_are_named_are_judged_alone_and_all_are_counted_in_the_readme(make):
    made = make("lemma-2", "peak-time")

    assert [*made.claims] == ["lemma-2", "peak-time"]
    assert made.answer["items"] == []
    assert made.answer["errata"] is None
    page = (made.folder / "index.html").read_text("utf-8")
    assert page.index('id="claim-peak-time"') < page.index('id="claim-lemma-2"')
    counted = Counter(verdict for verdict, *_ in VERDICTS.values())
    said = re.search(
        r"Of its (\d+) claims, (\d+) are reproduced, (\d+) partly, (\d+) are not, and (\d+) cannot",
        (ROOT / "README.md").read_text("utf-8"),
    )
    kinds = ("reproduced", "partly", "not reproduced", "not checkable")
    assert [int(x) for x in said.groups()] == [len(VERDICTS), *(counted[x] for x in kinds)]


def test_an_unknown_item_is_refused_with_those_there_are(here_alone):
    for typed, words in (("fig11", "fig1, gains, fig2"), ("lema-2", "did you mean lemma-2?")):
        out, err = flighttune("reproduce", typed, "--out", "o", status=2)
        assert out == ""
        assert words in err
        assert err.count("\n") == 1
    assert not [*here_alone.iterdir()]


@pytest.fixture
def here_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path
