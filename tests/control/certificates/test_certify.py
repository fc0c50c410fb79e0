"""Certificates: valid ones hold in flight, changed ones are refused with what fails."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_up_tubes import tube
from places import SHIPPED_AIRCRAFT
from printed import L_D, MODEL
from scipy.integrate import solve_ivp

import flighttune as ft
from flighttune.base.files.table import tables_of, value_of
from flighttune.control.certificates import certificate as certificates
from flighttune.control.certificates.make import certify_model
from flighttune.control.linear_model import Envelope, JacobianHull, entry_model
from flighttune.control.tuning.envelope import largest_factor

G = 9.81
TUNED = ft.PIGains(K_P=np.diag([2.2209, 2.4797]), K_I=3.8753 * np.eye(2))
ENVELOPE = Envelope(
    V_a=(22.0, 28.0),
    gamma=(np.deg2rad(-15.0), np.deg2rad(45.0)),
    phi=(np.deg2rad(-20.0), np.deg2rad(20.0)),
    n_z=(0.8, 1.3),
)
CLAIMED_LESS = 1e-6


@pytest.fixture(scope="module")
def at_trim():
    return certify_model(MODEL, ft.PAPER_GAINS, L_d=L_D).certificate


@pytest.fixture(scope="module")
def over_envelope():
    return certify_model(
        MODEL, TUNED, envelope=ENVELOPE, g=G, L_d=L_D, scenario_sha256="0" * 64
    ).certificate


def changed(certificate, path, change):
    """The certificate with one number of its file put through `change`."""
    tables = json.loads(json.dumps(tables_of(certificate)))
    at = tables
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = change(at.get(path[-1]) if isinstance(at, dict) else at[path[-1]])
    return value_of(tables, ft.Certificate)


def test_the_papers_gains_are_certified_for_their_rate_and_the_ellipsoids_radius(at_trim):
    assert at_trim.claim.rate == pytest.approx(0.4599306, rel=CLAIMED_LESS)
    assert at_trim.claim.radius == pytest.approx(0.0333, abs=5e-5)
    assert ft.verify(at_trim).valid


def test_a_weak_certificate_says_what_it_is_worth(at_trim):
    weak = ft.PIGains(K_P=ft.PAPER_GAINS.K_P, K_I=2e-5 * np.eye(2))

    made = certify_model(MODEL, weak)

    loop = ft.loop.indicators(ft.loop.closed_loop(MODEL, weak))
    hours = 2.0 * np.log(2.0) / loop.R_K / 3600.0
    assert hours > 24.0
    assert at_trim.in_words == "certified"
    assert f"certified, but the proven rate halves errors in {hours:.2g} hours" in made.in_words
    assert f"an error may first grow {made.values['growth']:.0f}-fold" in made.in_words
    assert f"I_K of {loop.I_K:.2g} s² is too large to be a useful bound" in made.in_words


@pytest.mark.slow
def test_the_tuned_gains_are_certified_over_an_envelope(over_envelope):
    verification = ft.verify(over_envelope)
    names = [check.name for check in verification.checks]

    assert verification.valid
    assert verification.reason == ""
    assert all(check.exact and check.margin >= 0.0 for check in verification.checks)
    assert sum("A' Q + Q A + I <= 0" in name for name in names) == 32
    assert sum("A W + W A'" in name for name in names) == 32
    assert sum("of the envelope" in name for name in names) == 5


def test_a_file_reads_back_to_the_same_bits_and_verifies(over_envelope, tmp_path):
    path = tmp_path / "gains.json"

    over_envelope.save(path)
    again = ft.load(path)

    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()
    assert np.array_equal(again.Q, over_envelope.Q)
    assert ft.verify(path).valid
    assert again.scenario_sha256 == "0" * 64
    assert {"flighttune", "solver", "clarabel"} <= set(again.made_with)
    assert {file.name for file in tmp_path.iterdir()} == {"gains.json", "again.json"}


@pytest.mark.slow
def test_verifying_a_file_does_not_even_import_a_solver(over_envelope, tmp_path):
    path = tmp_path / "gains.json"
    over_envelope.save(path)
    code = (
        "import sys; from flighttune.control.certificates.certificate import load_certificate; "
        "assert load_certificate(sys.argv[1]).verify().valid; print('clarabel' in sys.modules)"
    )

    done = subprocess.run(
        [sys.executable, "-c", code, path], capture_output=True, text=True, check=True
    )

    assert done.stdout.split() == ["False"]


CHANGES = [
    (("claim", "rate"), lambda rate: 1.0001 * rate, "rate Q <= I"),
    (("claim", "radius"), lambda radius: 0.9999 * radius, "W <= radius^2 I"),
    (("claim", "L_d"), lambda L_d: 1.01 * L_d, "A W + W A' + a W"),
    (("claim", "envelope", "V_a"), lambda V_a: [21.9, V_a[1]], "g/V of the envelope"),
    (("claim", "envelope", "gamma"), lambda gamma: [gamma[0], 0.8], "a of the envelope"),
    (("claim", "g"), lambda g: 9.82, "g/V of the envelope"),
    (("Q", 0), lambda row: [1.02 * row[0], *row[1:]], ""),
    (("W", 1), lambda row: [row[0], 1.02 * row[1], *row[2:]], ""),
    (("multiplier",), lambda a: 1.1 * a, "A W + W A' + a W"),
    (("gains", "K_I", 0), lambda row: [1.1 * row[0], row[1]], "at vertex"),
    (("hull", "upper"), lambda upper: [*upper[:3], 1.01], "at vertex"),
    (("model", "A"), lambda A: [[0.1, 0.0], A[1]], "trim model inside the polytope"),
    (("model", "C"), lambda C: [[2.0, 0.0], [0.0, 2.0]], "trim model inside the polytope"),
]


@pytest.mark.parametrize(("path", "change", "inequality"), CHANGES)
def test_a_change_that_breaks_the_claim_is_refused_and_the_inequality_named(
    over_envelope, path, change, inequality
):
    verification = ft.verify(changed(over_envelope, path, change))

    assert not verification.valid
    failed = [check for check in verification.checks if not check.exact]
    assert any(inequality in check.name for check in failed)
    assert "margin" in verification.reason


@pytest.mark.soak
@settings(max_examples=100,
          suppress_health_check=[HealthCheck.function_scoped_fixture])  # fmt: skip
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


LOW = Envelope(V_a=(15.0, 20.0), gamma=(0.0, 0.5), phi=(0.0, 0.1), n_z=(0.9, 1.1))
WIDE = Envelope(V_a=(15.0, 40.0), gamma=(-0.8, 0.8), phi=(-1.0, 1.0), n_z=(-1.0, 3.0))


@pytest.mark.parametrize(
    ("gains", "envelope", "why"),
    [
        (TUNED, LOW, "trim model inside the polytope"),
        (ft.PAPER_GAINS, WIDE, "no common Q"),
        (ft.PIGains(K_P=-np.eye(2), K_I=np.eye(2)), None, "left half plane"),
    ],
)
def test_what_cannot_be_proven_is_refused_with_a_reason(gains, envelope, why):
    refused = certify_model(MODEL, gains, envelope=envelope, g=G if envelope else None)

    assert (refused.status, refused.certificate) == ("refused", None)
    assert why in refused.reason


@pytest.mark.soak
@pytest.mark.parametrize("gains", [ft.PAPER_GAINS, TUNED])
def test_the_largest_envelope_of_gains_can_be_proven_and_one_percent_more_cannot(gains):
    trim = Envelope.at(V_a=25.0, gamma=np.pi / 12)
    factor = largest_factor(gains, ENVELOPE, trim, g=G)

    largest, beyond = (ENVELOPE.scaled(trim, part * factor) for part in (1.0, 1.01))

    assert certify_model(MODEL, gains, envelope=largest, g=G).status == "certified"
    assert certify_model(MODEL, gains, envelope=beyond, g=G).status == "refused"


def test_envelope_and_gravity_go_together():
    with pytest.raises(ft.InputError, match="`envelope` and `g`"):
        certify_model(MODEL, TUNED, envelope=ENVELOPE)


@pytest.mark.parametrize(
    ("change", "words"), [({"rate": -1.0}, r"`rate`.*-1\.0"), ({"L_d": None}, "`radius` and `L_d`")]
)
def test_a_claim_must_be_positive(at_trim, change, words):
    with pytest.raises(ft.InputError, match=words):
        replace(at_trim.claim, **change)


GAMMA = np.pi / 12
INTEGRATION = 1e-6


def errors_rate(V_a, e, u, d):
    """Eq. (39) of arXiv 2411.13140: e' of the law, course reference 0, no limits."""
    phi, n_z = u
    return -np.array(
        [G / V_a * np.tan(phi), G / V_a * (n_z * np.cos(phi) - np.cos(GAMMA - e[1]))]
    ) - np.asarray(d)


def flight(V_a, e_0, d, duration):
    """s = (e', e) over time, and the commands, from a start trimmed but for the error."""
    xi_0 = np.linalg.solve(TUNED.K_I, [0.0, np.cos(GAMMA)])

    def rates(t, y):
        e, xi = y[:2], y[2:]
        return np.concatenate([errors_rate(V_a, e, TUNED.K_P @ e + TUNED.K_I @ xi, d(t)), e])

    t = np.linspace(0.0, duration, 4001)
    flown = solve_ivp(
        rates, (0.0, duration), np.concatenate([e_0, xi_0]), t_eval=t, rtol=1e-10, atol=1e-12
    )
    e, xi = flown.y[:2], flown.y[2:]
    u = TUNED.K_P @ e + TUNED.K_I @ xi
    e_dot = np.array([errors_rate(V_a, *at) for at in zip(e.T, u.T, map(d, t), strict=True)]).T
    return t, np.vstack([e_dot, e]), u


def stays_inside(s, u):
    ranges = (GAMMA - s[3], ENVELOPE.gamma), (u[0], ENVELOPE.phi), (u[1], ENVELOPE.n_z)
    return all(low <= x.min() and x.max() <= high for x, (low, high) in ranges)


@pytest.mark.parametrize("V_a", [22.0, 24.3, 28.0])
@pytest.mark.parametrize("e_0", [(0.1, -0.05), (-0.12, 0.08), (0.0, 0.1)])
def test_the_quadratic_form_decays_at_the_certified_rate_inside_the_envelope(
    over_envelope, V_a, e_0
):
    t, s, u = flight(V_a, np.array(e_0), lambda _: (0.0, 0.0), 15.0)

    form = np.einsum("it,ij,jt->t", s, over_envelope.Q, s)

    assert stays_inside(s, u)
    allowed = form[:-1] * np.exp(-over_envelope.claim.rate * np.diff(t))
    assert (form[1:] <= allowed * (1.0 + INTEGRATION) + 1e-14).all()


@pytest.mark.soak
@pytest.mark.parametrize("V_a", [22.0, 28.0])
@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_a_disturbance_of_the_papers_rate_leaves_the_loop_inside_the_certified_radius(
    over_envelope, V_a, sense
):
    """Half the amplitude at twice the frequency: the paper's own takes n_z out of this envelope."""

    def d(t):
        return 0.05 * np.sin(0.3 * t), sense * 0.05 * np.cos(0.3 * t)

    t, s, u = flight(V_a, np.zeros(2), d, 100.0)

    settled = t > 40.0
    assert stays_inside(s[:, settled], u[:, settled])
    assert np.linalg.norm(s[:, settled], axis=0).max() < over_envelope.claim.radius


@pytest.mark.soak
def test_a_proof_of_a_model_whose_file_has_changed_says_so(tmp_path):
    model, tube_file = tmp_path / "model.json", tmp_path / "tube.npz"
    text = (SHIPPED_AIRCRAFT / "aerosonde/identified.json").read_text()
    model.write_text(text)
    tables = ft.load_scenario("paper").as_dict() | {"gains": ["paper"], "expect": []}
    tables["flight"]["duration_s"] = 0.5
    tables["plant"] = [{"kind": "point_mass_lag", "identified": str(model)}]
    tables["tuning"] |= {"model": "identified", "identified": str(model)}
    scenario = ft.scenario_from(tables)
    certificate = ft.certify(scenario, "paper").certificate
    certificate.save(tmp_path / "proof.json")
    law = ft.load_scenario("paper", changes={"flight.duration_s": 0.2})
    files = certificate.files  # as a tube of the same model has: that is longer to prove
    replace(tube(law, ft.PAPER_GAINS, for_ever=False), files=files).save(tube_file)
    flown = ft.fly(law, gains=["paper"])
    said = f"The files of {model} are no longer those that it was made with"
    for file in ("proof.json", "tube.npz"):
        assert said not in " ".join(ft.verify(tmp_path / file).answer().notes)
    assert any(run.claims for run in flown.within(ft.load(tube_file)).runs)

    model.write_text(json.dumps(json.loads(text) | {"seed": 12345}))

    for file in ("proof.json", "tube.npz"):
        assert said in " ".join(ft.verify(tmp_path / file).answer().notes)
    page = tmp_path / "proof.html"
    ft.report(tmp_path / "proof.json", page)
    assert "no longer those that it was made with" in page.read_text()
    with pytest.raises(ft.InputError, match=r"must be those .* proven"):
        flown.within(ft.load(tube_file))


def test_models_have_the_gravity_of_the_law_at_their_own_speeds_and_angles_or_none():
    conditions = [(25.0, np.pi / 12), (30.0, -0.1)]
    at = [ft.loop.kinematic_model(V_a=V_a, gamma=gamma, g=1.62) for V_a, gamma in conditions]

    assert certificates.law_gravity(conditions, at) == pytest.approx(1.62)
    assert certificates.law_gravity(conditions[::-1], at) is None
    heavier = ft.loop.kinematic_model(V_a=30.0, gamma=-0.1, g=3.7)
    assert certificates.law_gravity(conditions, [at[0], heavier]) is None
    assert certificates.law_gravity(conditions[:1], [replace(at[0], B=0.0 * at[0].B)]) is None
    assert certificates.law_gravity(conditions[:1], [replace(at[0], B=-at[0].B)]) is None
    assert certificates.law_gravity([(25.0, np.pi / 2)], at[:1]) is None


@pytest.mark.parametrize("phi", [(-0.3, 0.5), (0.0, 0.5), (-0.5, 0.0), (0.1, 0.5), (-0.5, -0.1)])
@pytest.mark.parametrize("n_z", [(0.8, 1.3), (-0.4, 1.3), (-1.3, -0.8)])
def test_the_polytope_is_as_far_outside_an_envelope_as_its_margins_say(phi, n_z):
    """Against the law's entries on a grid of 21 x 21 conditions, which has every extreme."""
    envelope = Envelope(V_a=(20.0, 25.0), gamma=(-0.2, 0.4), phi=phi, n_z=n_z)
    rolls = np.append(np.linspace(*phi, 21), np.clip(0.0, *phi))
    roll, load = np.meshgrid(rolls, np.linspace(*n_z, 21))
    entries = np.sin([-0.2, 0.4]), np.cos(roll) ** -2, load * np.sin(roll), np.cos(roll)
    low, high = (np.array([end(x) for x in entries]) for end in (np.min, np.max))
    below, above = np.array([0.1, 0.02, 0.3, 0.04]), np.array([0.01, 0.2, 0.03, 0.4])
    model = ft.loop.kinematic_model(V_a=22.0, gamma=0.1, g=G)

    def margins(hull):
        checks = certificates.coverage_checks(model, envelope, hull, g=G)
        assert [check.name.split()[0] for check in checks] == ["g/V", "a", "b1", "b2", "b3", "trim"]
        return [check.margin for check in checks], [check.exact for check in checks]

    factor = (G / 25.0 - 0.02, G / 20.0 + 0.01)
    hull = JacobianHull(factor=factor, lower=low - below, upper=high + above)
    found, exact = margins(hull)
    assert found[:5] == pytest.approx([0.01, 0.01, 0.02, 0.03, 0.04])
    assert exact[:5] == [True] * 5
    found, exact = margins(replace(hull, lower=low + 0.5 * below * (high > low)))
    narrow = 0.5 * below * (high > low)
    assert found[1:5] == pytest.approx(np.minimum(-narrow, above))
    assert exact[1:5] == (narrow == 0.0).tolist()
    found, _ = margins(replace(hull, factor=(G / 25.0 + 0.01, factor[1])))
    assert found[0] == pytest.approx(-0.01)


@pytest.mark.parametrize(
    ("entries", "margin"),
    [
        # each entry over its side of the box, -1..1, 1..2, -0.5..0 and 0..1, allows some factors
        ((0.0, 0.6, 0.0, 0.2), 0.2),  # b1 / 2 = 0.3 up to 0.5
        ((0.4, 0.6, 0.0, 0.2), 0.1),  # a = 0.4 needs 0.4 up to 0.5
        ((-0.4, 0.6, 0.0, 0.2), 0.1),
        ((0.0, 0.4, 0.0, 0.2), 0.1),  # b1 = 0.4 needs a factor of 0.4 at most
        ((0.0, 0.8, -0.2, 0.2), 0.1),  # b1 needs 0.4 and b2 too
        ((0.0, 0.6, 0.0, 0.45), 0.05),
        ((0.6, 0.6, 0.0, 0.2), -0.1),  # a needs 0.6
        ((0.0, 0.6, 0.01, 0.2), -0.01),  # no factor makes b2 positive
        ((0.0, 0.6, 0.0, -0.02), -0.02),  # nor b3 negative
    ],
)  # fmt: skip
def test_a_model_is_inside_a_polytope_by_the_factors_that_all_its_entries_allow(entries, margin):
    hull = JacobianHull(
        factor=(0.3, 0.5),
        lower=np.array([-1.0, 1.0, -0.5, 0.0]),
        upper=np.array([1.0, 2.0, 0.0, 1.0]),
    )

    check = certificates._model_check(entry_model(np.array(entries)), hull)

    assert check.margin == pytest.approx(margin)
    assert check.exact == (margin >= 0.0)


@pytest.mark.parametrize("change", [{"A": np.diag([0.1, 0.0])}, {"C": -np.eye(2)}])
def test_a_model_of_another_law_is_in_no_polytope(change):
    hull = JacobianHull(factor=(0.3, 0.5), lower=-2.0 * np.ones(4), upper=2.0 * np.ones(4))
    model = entry_model(np.array([0.0, 0.6, 0.0, 0.2]))

    assert certificates._model_check(model, hull).exact
    check = certificates._model_check(replace(model, **change), hull)
    assert (check.exact, check.margin) == (False, -np.inf)


def test_a_claim_says_where_it_holds(at_trim, over_envelope):
    several = certificates.Claim(rate=0.4, conditions=((30.0, 0.0), (20.0, np.deg2rad(-5.0))))

    assert at_trim.claim.place == "at the trim"
    assert over_envelope.claim.place == (
        "over the envelope V_a 22..28 m/s, gamma -15..45 deg, phi -20..20 deg, n_z 0.8..1.3"
    )
    assert several.place == (
        "at 2 conditions, which its maker states as V_a 20..30 m/s and gamma -5..0 deg, and for "
        "every mixture of their loops"
    )
    assert "the norm ends up at" in at_trim.sentence
    assert f"derivative is at most {L_D:.6g} " in at_trim.sentence
    rate_alone = replace(at_trim.claim, radius=None, L_d=None)
    alone = replace(at_trim, claim=rate_alone, W=None, multiplier=None)
    assert "the norm ends up at" not in alone.sentence
    # sqrt(condition) is the ratio of the axes of an ellipsoid s' Q s = 1
    axes = np.linalg.eigvalsh(at_trim.Q)
    assert at_trim.growth == pytest.approx((axes[-1] / axes[0]) ** 0.5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"W": None}, "`radius`, `W` and `multiplier` must be given together"),
        ({"multiplier": np.inf}, "`multiplier` must be finite"),
        ({"hull": JacobianHull(factor=(1.0, 1.0), lower=np.ones(4), upper=np.ones(4))},
         "`envelope` and `hull` must be given together"),
        ({"models": (MODEL,)}, "got 1 models and 0 conditions"),
        ({"gains": ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)}, "`gains` must act from"),
        ({"Q": np.eye(3)}, r"`Q` must have shape \(4, 4\)"),
        ({"peak_gains": np.eye(3)}, r"`peak_gains` must have shape \(2, 2\)"),
    ],
)  # fmt: skip
def test_parts_of_a_certificate_that_do_not_fit_are_refused(at_trim, change, says):
    with pytest.raises(ft.InputError, match=says):
        replace(at_trim, **change)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"conditions": ((0.0, 0.1),)}, "`conditions` must be positive airspeeds"),
        ({"conditions": ((20.0, np.nan),)}, "`conditions` must be positive airspeeds"),
        ({"conditions": ((20.0, 0.1),), "envelope": ENVELOPE, "g": G}, "must be empty with"),
        ({"envelope": ENVELOPE}, "`envelope` and `g` must be given together"),
        ({"radius": -1.0}, "`radius`"),
        ({"g": 0.0, "envelope": ENVELOPE}, "`g`"),
    ],
)
def test_a_claim_whose_parts_do_not_fit_is_refused(at_trim, change, says):
    with pytest.raises(ft.InputError, match=says):
        replace(at_trim.claim, **change)
