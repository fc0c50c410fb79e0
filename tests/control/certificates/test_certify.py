"""Certificates: valid ones hold in flight, changed ones are refused with what fails."""

import json
from dataclasses import replace

import numpy as np
import pytest
from forging import Opened
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_up import made_up_scenario
from made_up_tubes import tube
from places import SHIPPED_AIRCRAFT
from printed import A_K, L_D, MODEL, E
from scipy.integrate import solve_ivp

import flighttune as ft

G, GAMMA = 9.81, np.pi / 12
TUNED = ft.PIGains(K_P=np.diag([2.2209, 2.4797]), K_I=3.8753 * np.eye(2))
INTEGRATION = 1e-6
RANGES = {"V_a_mps": [22, 28], "gamma_deg": [-15, 45], "phi_deg": [-20, 20], "n_z": [0.8, 1.3]}


def over(ranges, gains=TUNED, **options):
    changes = {f"envelope.{key}": value for key, value in ranges.items()}
    return ft.certify("paper", gains, envelope=True, changes=changes, **options)


@pytest.fixture(scope="module")
def at_trim():
    return ft.certify(MODEL, ft.PAPER_GAINS, L_d=L_D).certificate


@pytest.fixture(scope="module")
def over_envelope():
    return over(RANGES, L_d=L_D)


def test_a_certificate_proves_its_inequalities_by_eigenvalues_too(at_trim):
    Q, W, a = at_trim.Q, at_trim.W, at_trim.multiplier
    flow = A_K @ W + W @ A_K.T + a * W + L_D**2 / a * E @ E.T

    assert at_trim.claim.rate == pytest.approx(0.4599306, rel=1e-6)
    assert at_trim.claim.rate == pytest.approx(1.0 / np.linalg.eigvalsh(Q)[-1], rel=1e-6)
    assert at_trim.claim.radius == pytest.approx(0.0333, abs=5e-5)
    assert at_trim.claim.radius == pytest.approx(np.sqrt(np.linalg.eigvalsh(W)[-1]), rel=1e-6)
    assert np.linalg.eigvalsh(A_K.T @ Q + Q @ A_K + np.eye(4))[-1] < 0.0
    assert np.linalg.eigvalsh(flow)[-1] < 0.0
    assert at_trim.growth == pytest.approx(np.sqrt(np.linalg.cond(Q)))


@pytest.mark.parametrize("factor", [0.01, 3.0])
def test_the_radius_is_in_proportion_to_the_disturbance(at_trim, factor):
    scaled = ft.certify(MODEL, ft.PAPER_GAINS, L_d=factor * L_D).certificate

    assert scaled.claim.radius == pytest.approx(factor * at_trim.claim.radius, rel=1e-4)
    assert scaled.claim.rate == at_trim.claim.rate


def test_a_weak_certificate_says_what_it_is_worth(at_trim):
    weak = ft.PIGains(K_P=ft.PAPER_GAINS.K_P, K_I=2e-5 * np.eye(2))
    made, loop = ft.certify(MODEL, weak), ft.loop.indicators(ft.loop.closed_loop(MODEL, weak))
    slowest = -np.linalg.eigvals(ft.loop.closed_loop(MODEL, weak)).real.max()

    assert at_trim.in_words == "certified"
    assert "halves errors in" in made.in_words
    assert f"I_K of {loop.I_K:.2g} s²" in made.in_words
    halved = np.log(2.0) / slowest / 3600.0
    assert made.certificate.exact_rates[0].rate == pytest.approx(slowest, rel=0.01)
    assert f"{halved:.2g} hours" in made.in_words


@pytest.mark.slow
def test_the_tuned_gains_are_certified_over_an_envelope(over_envelope, tmp_path):
    certificate, path = over_envelope.certificate, tmp_path / "gains.json"
    certificate.save(path)
    names = [check.name for check in ft.verify(certificate).checks]
    again = ft.load(path)
    again.save(tmp_path / "again.json")

    assert ft.verify(path).valid
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()
    assert sum("A' Q + Q A + I <= 0" in name for name in names) == 32
    assert sum("A W + W A'" in name for name in names) == 32
    assert sum("of the envelope" in name for name in names) == 5


@pytest.mark.slow
def test_the_polytope_of_an_envelope_has_the_ends_worked_out_by_hand(over_envelope):
    """The sine grows, the cosine is largest at zero roll, the lift at ends of both its factors."""
    hull, claim, roll = over_envelope.certificate.hull, over_envelope.certificate.claim, np.pi / 9.0

    assert hull.factor == pytest.approx((G / 28.0, G / 22.0), rel=1e-12)
    lower = [-np.sin(np.pi / 12.0), 1.0, -1.3 * np.sin(roll), np.cos(roll)]
    upper = [np.sin(np.pi / 4.0), np.cos(roll) ** -2, 1.3 * np.sin(roll), 1.0]
    assert hull.lower == pytest.approx(lower, rel=1e-12)
    assert hull.upper == pytest.approx(upper, rel=1e-12)
    assert (hull.lower < lower).all()  # rounded outward
    assert (hull.upper > upper).all()
    for ends in ("22..28", "-15..45", "-20..20", "0.8..1.3"):
        assert ends in claim.place
    aside = over(RANGES | {"phi_deg": [0, 20], "n_z": [0.9, 1.3]}).certificate.hull
    assert (aside.lower[2], aside.upper[2]) == pytest.approx((0.0, 1.3 * np.sin(roll)), abs=1e-12)
    assert (aside.lower[1], aside.upper[3]) == pytest.approx((1.0, 1.0), rel=1e-12)


@pytest.mark.slow
def test_one_common_q_holds_at_conditions_drawn_from_the_envelope(over_envelope):
    certificate = over_envelope.certificate
    Q, W, a = certificate.Q, certificate.W, certificate.multiplier
    low, high = np.array([(22, 28), *np.deg2rad([(-15, 45), (-20, 20)]), (0.8, 1.3)]).T

    for V_a, gamma, phi, n_z in np.random.default_rng(0).uniform(low, high, (300, 4)):
        model = ft.loop.kinematic_model(V_a=V_a, gamma=gamma, phi=phi, n_z=n_z, g=G)
        A = ft.loop.closed_loop(model, TUNED)
        assert np.linalg.eigvalsh(A.T @ Q + Q @ A + np.eye(4))[-1] < 0.0
        assert np.linalg.eigvalsh(A @ W + W @ A.T + a * W + L_D**2 / a * E @ E.T)[-1] < 0.0
        assert ft.loop.indicators(A).R_K >= certificate.claim.rate


@pytest.mark.slow
def test_the_largest_envelope_of_gains_can_be_proven_and_one_percent_more_cannot(over_envelope):
    trim = {"V_a_mps": 25.0, "gamma_deg": 15.0, "phi_deg": 0.0, "n_z": 1.0}
    shares = over_envelope.largest_factor * np.array([1.0, 1.01])
    scaled = [
        {key: [trim[key] + share * (x - trim[key]) for x in RANGES[key]] for key in trim}
        for share in shares
    ]

    assert [over(ranges).status for ranges in scaled] == ["certified", "refused"]


CHANGES = [
    (("claim", "rate"), lambda rate: 1.0001 * rate, "rate Q <= I"),
    (("claim", "radius"), lambda radius: 0.9999 * radius, "W <= radius^2 I"),
    (("claim", "L_d"), lambda L_d: 1.01 * L_d, "A W + W A' + a W"),
    (("claim", "envelope", "V_a"), lambda V_a: [21.9, V_a[1]], "g/V of the envelope"),
    (("claim", "envelope", "V_a"), lambda V_a: [V_a[0], 28.1], "g/V of the envelope"),
    (("claim", "envelope", "gamma"), lambda gamma: [gamma[0], 0.8], "a of the envelope"),
    (("claim", "envelope", "gamma"), lambda gamma: [-0.3, gamma[1]], "a of the envelope"),
    (("claim", "envelope", "phi"), lambda phi: [-0.36, phi[1]], "b1 of the envelope"),
    (("claim", "envelope", "phi"), lambda phi: [phi[0], 0.36], "b3 of the envelope"),
    (("claim", "envelope", "n_z"), lambda n_z: [n_z[0], 1.31], "b2 of the envelope"),
    (("claim", "g"), lambda g: 9.82, "g/V of the envelope"),
    (("claim", "g"), lambda g: 9.80, "g/V of the envelope"),
    (("multiplier",), lambda a: 1.1 * a, "A W + W A' + a W"),
    (("multiplier",), lambda a: 0.9 * a, "A W + W A' + a W"),
    (("gains", "K_I", 0), lambda row: [1.1 * row[0], row[1]], "at vertex"),
    (("hull", "upper"), lambda upper: [*upper[:3], 1.01], "at vertex"),
    (("model", "A"), lambda A: [[0.1, 0.0], A[1]], "trim model inside the polytope"),
    (("model", "B"), lambda B: [B[0], [1.0, B[1][1]]], "trim model inside the polytope"),
    (("model", "C"), lambda C: [[2.0, 0.0], [0.0, 2.0]], "trim model inside the polytope"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "change", "inequality"), CHANGES)
def test_a_change_that_breaks_the_claim_is_refused_and_the_inequality_named(
    over_envelope, tmp_path, path, change, inequality
):
    file = tmp_path / "forged.json"
    over_envelope.certificate.save(file)
    opened = Opened.of(file)
    at = opened.tables
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = change(at[path[-1]])
    opened.write(file, anew=True)

    verification = ft.verify(file)

    assert not verification.valid
    failed = [check for check in verification.checks if not check.exact]
    assert any(inequality in check.name for check in failed)
    assert "margin" in verification.reason


@pytest.mark.soak
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    key=st.sampled_from(["Q", "W"]),
    row=st.integers(0, 3),
    column=st.integers(0, 3),
    power=st.floats(-14.0, 0.0),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_whatever_is_changed_the_exact_verdict_is_that_of_the_eigenvalues(
    at_trim, key, row, column, power, sign
):
    """Symmetrically, so that only the inequalities decide; undecided within rounding."""
    matrix = np.array(getattr(at_trim, key))
    change = sign * 10.0**power * np.abs(matrix).max()
    matrix[row, column] += change
    matrix[column, row] = matrix[row, column]

    verification = ft.verify(replace(at_trim, **{key: matrix}))
    least = min(check.margin for check in verification.checks)

    if abs(least) > 1e-13:
        assert verification.valid == (least > 0.0)


def test_a_matrix_that_is_unsymmetric_by_one_bit_proves_nothing(at_trim):
    for key in ("Q", "W"):
        matrix = np.array(getattr(at_trim, key))
        matrix[0, 1] = np.nextafter(matrix[0, 1], 9.0)
        assert not ft.verify(replace(at_trim, **{key: matrix})).valid


LOW = {"V_a_mps": [15, 20], "gamma_deg": [0, 28], "phi_deg": [0, 6], "n_z": [0.9, 1.1]}
WIDE = {"V_a_mps": [15, 40], "gamma_deg": [-45, 45], "phi_deg": [-57, 57], "n_z": [-1, 3]}


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (lambda: over(WIDE, ft.PAPER_GAINS), "no common Q"),
        (lambda: ft.certify(MODEL, ft.PIGains(K_P=-np.eye(2), K_I=np.eye(2))), "left half plane"),
    ],
    ids=["envelope", "unstable"],
)
def test_what_cannot_be_proven_is_refused_with_a_reason(made, why):
    refused = made()

    assert (refused.status, refused.certificate) == ("refused", None)
    assert why in refused.reason
    assert refused.values["rate"] is None


@pytest.mark.slow
def test_of_an_envelope_that_is_too_wide_the_largest_provable_part_is_told():
    factor = over(WIDE, ft.PAPER_GAINS).largest_factor
    trim = dict(zip(WIDE, (25.0, 15.0, 0.0, np.cos(GAMMA)), strict=True))

    def part(share):
        ranges = {key: [trim[key] + share * (x - trim[key]) for x in WIDE[key]] for key in WIDE}
        return over(ranges, ft.PAPER_GAINS).status

    assert 0.0 < factor < 1.0
    assert [part(factor), part(1.01 * factor)] == ["certified", "refused"]


def test_the_disturbance_of_a_scenario_counts_by_the_largest_norm_of_its_derivative():
    """Of channels a quarter period apart the larger one, of two frequencies by Pythagoras."""
    swing = {"chi_amplitude": 0.02, "gamma_amplitude": 0.03}
    rows = [
        ({"chi_omega_rad_s": 0.5, "gamma_omega_rad_s": 0.5}, 0.015),
        ({"chi_omega_rad_s": 0.5, "gamma_omega_rad_s": 0.4}, np.hypot(0.01, 0.012)),
        ({"chi_omega_rad_s": 0.5, "gamma_omega_rad_s": 0.5, "chi_phase_deg": 90.0},
         np.hypot(0.01, 0.015)),
        ({"chi_omega_rad_s": 0.5, "gamma_omega_rad_s": 0.4, "wave": "square"}, None),
    ]  # fmt: skip
    for table, L_d in rows:
        made = made_up_scenario(disturbance=swing | table)
        claim = ft.certify(made, "paper").certificate.claim
        assert claim.L_d == (L_d and pytest.approx(L_d))


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: over(LOW), "25"),
        (lambda: over({"phi_deg": [-20, 91]}), "phi_deg"),
        (lambda: over({"gamma_deg": [20, 10]}), "gamma_deg"),
        (lambda: over({"V_a_mps": [0, 30]}), "V_a_mps"),
        (lambda: over(RANGES, lag=(0.1, 0.2)), "`lag` must be absent"),
        (lambda: ft.certify(MODEL, TUNED, envelope=True), "`envelope`, `lag` and `navigation` not"),
        (lambda: ft.certify(MODEL), "`gains` must be given"),
        (lambda: ft.certify(MODEL, TUNED, L_d=0.0), "`L_d` must be positive"),
        (lambda: ft.certify(MODEL, TUNED, L_d=1e7), "`L_d` must be at most"),
        (lambda: ft.certify("mission", navigation="rtk+"), "`navigation` must be 'rtk'"),
        (lambda: ft.certify("mission", lag=(0.6, 0.2)), "`lag` must be"),
    ],
)
def test_what_cannot_be_certified_is_refused_by_name(made, words):
    with pytest.raises(ft.FlightTuneError, match=words):
        made()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: {"claim": replace(x.claim, rate=-1.0)}, r"`rate`.*-1\.0"),
        (lambda x: {"claim": replace(x.claim, L_d=None)}, "`radius` and `L_d`"),
        (lambda x: {"W": None}, "`W`"),
        (lambda x: {"Q": np.eye(3)}, "`Q` must have shape"),
        (lambda x: {"models": (x.model,)}, "`models` must be one a condition"),
        (lambda x: {"peak_gains": np.ones((1, 2))}, "`peak_gains` must have shape"),
        (lambda x: {"multiplier": None}, "`multiplier`"),
    ],
)
def test_parts_of_a_certificate_that_do_not_fit_are_refused(at_trim, change, words):
    with pytest.raises(ft.InputError, match=words):
        replace(at_trim, **change(at_trim))


def flight(V_a, e_0, d, duration):
    """s = (e', e) over time, and the commands: eq. (39) of arXiv 2411.13140, reference 0."""

    def rates(e, u, now):
        phi, n_z = u
        lift = n_z * np.cos(phi) - np.cos(GAMMA - e[1])
        return -np.array([G / V_a * np.tan(phi), G / V_a * lift]) - np.asarray(now)

    def slope(t, y):
        e, xi = y[:2], y[2:]
        return np.concatenate([rates(e, TUNED.K_P @ e + TUNED.K_I @ xi, d(t)), e])

    t, start = np.linspace(0.0, duration, 4001), np.linalg.solve(TUNED.K_I, [0.0, np.cos(GAMMA)])
    tight = {"t_eval": t, "rtol": 1e-10, "atol": 1e-12}
    y = solve_ivp(slope, (0.0, duration), np.concatenate([e_0, start]), **tight).y
    e, u = y[:2], TUNED.K_P @ y[:2] + TUNED.K_I @ y[2:]
    e_dot = np.array([rates(*at) for at in zip(e.T, u.T, map(d, t), strict=True)]).T
    return t, np.vstack([e_dot, e]), u


def stays_inside(s, u):
    ranges = (GAMMA - s[3], (-15, 45)), (u[0], (-20, 20))
    angles = all(np.deg2rad(a) <= x.min() and x.max() <= np.deg2rad(b) for x, (a, b) in ranges)
    return angles and u[1].min() >= 0.8 and u[1].max() <= 1.3


@pytest.mark.slow
@pytest.mark.parametrize(("V_a", "e_0"), [(22.0, (0.1, -0.05)), (28.0, (-0.12, 0.08))])
def test_the_quadratic_form_decays_at_the_certified_rate_inside_the_envelope(
    over_envelope, V_a, e_0
):
    certificate = over_envelope.certificate
    t, s, u = flight(V_a, np.array(e_0), lambda _: (0.0, 0.0), 15.0)
    form = np.einsum("it,ij,jt->t", s, certificate.Q, s)

    assert stays_inside(s, u)
    allowed = form[:-1] * np.exp(-certificate.claim.rate * np.diff(t))
    assert (form[1:] <= allowed * (1.0 + INTEGRATION) + 1e-14).all()


@pytest.mark.soak
def test_a_disturbance_of_the_papers_rate_leaves_the_loop_inside_the_certified_radius(
    over_envelope,
):
    """Half the amplitude at twice the frequency: the paper's own takes n_z out of this envelope."""

    def d(t):
        return 0.05 * np.sin(0.3 * t), 0.05 * np.cos(0.3 * t)

    t, s, u = flight(22.0, np.zeros(2), d, 100.0)

    settled = t > 40.0
    assert stays_inside(s[:, settled], u[:, settled])
    radius = over_envelope.certificate.claim.radius
    assert np.linalg.norm(s[:, settled], axis=0).max() < radius


@pytest.mark.soak
def test_a_proof_of_a_model_whose_file_has_changed_says_so(tmp_path):
    model, tube_file = tmp_path / "model.json", tmp_path / "tube.npz"
    text = (SHIPPED_AIRCRAFT / "aerosonde/identified.json").read_text()
    model.write_text(text)
    tables = ft.load_scenario("paper").as_dict() | {"gains": ["paper"], "expect": []}
    tables["flight"]["duration_s"] = 0.5
    tables["plant"] = [{"kind": "point_mass_lag", "identified": str(model)}]
    tables["tuning"] |= {"model": "identified", "identified": str(model)}
    certificate = ft.certify(ft.scenario_from(tables), "paper").certificate
    certificate.save(tmp_path / "proof.json")
    law = ft.load_scenario("paper", changes={"flight.duration_s": 0.2})
    files = certificate.files  # as a tube of the same model has: that is longer to prove
    replace(tube(law, ft.PAPER_GAINS, for_ever=False), files=files).save(tube_file)
    flown = ft.fly(law, gains=["paper"])
    said = f"The files of {model} are no longer those that it was made with"
    for file in ("proof.json", "tube.npz"):
        assert said not in " ".join(ft.verify(tmp_path / file).answer().notes)

    model.write_text(json.dumps(json.loads(text) | {"seed": 12345}))

    for file in ("proof.json", "tube.npz"):
        assert said in " ".join(ft.verify(tmp_path / file).answer().notes)
    with pytest.raises(ft.InputError, match=r"must be those .* proven"):
        flown.within(ft.load(tube_file))
