"""Fits of factors to logs of made-up models, whose signals are known functions of the factors."""

import numpy as np
import pytest

from flighttune.gaps import of_log

# Six stretches of 17 s, whose first 5 s do not count.
TIMES = 20.0 * np.arange(6)[:, None] + 0.1 * np.arange(170)

COUNTED = TIMES[0] >= 5.0

# A delay is known no better than the age of a command, which is uniform up to 0.02 s.
AGE = 0.95 * 0.5 * 0.02

EXACT = 1e-6

# A fit ends where the sum of squares falls by less than a hundredth.
ENDED = 0.03

ARCTANGENTS = (
    (1.45, lambda x: np.arctan(3.0 * (x - 1.45))),
    (2.0, lambda x: np.arctan(5.0 * (x - 2.0))),
)


class MadeUp(of_log._Flights):
    """Flights whose roll and load factor are sums of the effects of scaled factors.

    Each factor has its own way over the time, at random; `mixed` has their sums. The log has the
    factors of `truth`, and `noise` in the scales of its signals.
    """

    def __init__(self, truth, *, effect=None, mixed=None, noise=0.0, seed=0):
        random = np.random.default_rng(seed)
        self.notes, self._places, self.t = [], [], TIMES
        self.nominal = {name: of_log.FACTORS[name].nominal for name in truth}
        self.names, self.effect = [*truth], effect or (lambda scaled: scaled)
        ways = random.standard_normal((len(truth), 2, *TIMES.shape))
        self.ways = ways if mixed is None else np.tensordot(mixed, ways, 1)
        self.logged = {
            name: values + noise * of_log.SCALES[name] * random.standard_normal(TIMES.shape)
            for name, values in self.fly(truth).items()
        }

    def fly(self, factors, maker=None):
        known = [of_log.FACTORS[name] for name in self.names]
        values = [factors.get(name, of_log.FACTORS[name].nominal) for name in self.names]
        scaled = [(value - x.nominal) / x.size for value, x in zip(values, known, strict=True)]
        flown = np.tensordot(self.effect(np.array(scaled)), self.ways, 1)
        return {name: of_log.SCALES[name] * flown[i] for i, name in enumerate(("phi", "n_z"))}


def found(flights):
    return {name: value for name, (value, _, _) in of_log._fitted(flights).items()}


FAR = {
    "phi_late": 0.72, "n_z_late": -0.15, "mass": 2.4, "damping": 0.5, "wind_north": 12.0,
    "wind_east": -41.0,
}  # fmt: skip
"""Up to eight sizes from the nominal values, so that the fit takes several steps."""


def test_factors_far_from_nominal_come_back_and_a_delay_has_the_age_of_a_command():
    flights = MadeUp(FAR, effect=lambda x: x + 0.01 * x**2)

    fitted = of_log._fitted(flights)

    assert [*fitted] == [*FAR]
    for name, (value, low, high) in fitted.items():
        age = AGE if name.endswith("_late") else 0.0
        assert value == pytest.approx(FAR[name], abs=1e-3 * of_log.FACTORS[name].size)
        assert (high - value, value - low) == pytest.approx((age, age), abs=EXACT)
    assert not flights.notes


def test_nineteen_of_twenty_intervals_hold_the_truth():
    """Of 240; the number is within 4 standard deviations of a binomial."""
    truth = {"mass": 1.2, "damping": 1.0, "wind_north": 3.0, "wind_east": -4.0}

    held = [
        low < truth[name] < high
        for seed in range(60)
        for name, (_, low, high) in of_log._fitted(MadeUp(truth, noise=5.0, seed=seed)).items()
    ]

    assert len(held) == 240
    assert np.mean(held) == pytest.approx(0.95, abs=4.0 * np.sqrt(0.05 * 0.95 / 240))


def test_a_factor_without_effect_or_with_that_of_another_is_left_at_its_nominal_value():
    truth = {"mass": 1.3, "phi_late": 0.1, "wind_north": 4.0}
    mixed = np.diag([1.0, 1.0, 0.0])
    without = MadeUp(truth, mixed=mixed)
    mixed[2, 0] = 0.5  # of 0.8 of its sizes, where mass has 1.5
    alike = MadeUp(truth, mixed=mixed)

    assert found(without) == pytest.approx({"mass": 1.3, "phi_late": 0.1})
    assert found(alike) == pytest.approx({"phi_late": 0.1, "wind_north": 5.0 * (0.8 + 1.5 / 0.5)})
    (said,), (also,) = without.notes, alike.notes
    assert said.startswith("The log cannot identify air moving north: a change of it has the same")
    assert also.startswith("The log cannot identify mass over the model's: a change of it has the")
    assert (said[-17:], also[-17:]) == ("it is taken as 0.", "it is taken as 1.")


@pytest.mark.parametrize(
    ("effects", "told", "title", "range_"),
    [
        ((1.0, 0.3), "mass", "damping over", "0.1 to 5"),
        ((0.3, 1.0), "damping", "mass over", "0.3 to 3"),
    ],
)
def test_of_two_factors_that_noise_does_not_tell_apart_the_one_of_less_effect_is_left(
    effects, told, title, range_
):
    """Both are 2 sizes from nominal, and all but a tenth of their ways is the same."""
    same = [[effects[0], 0.0], [0.995 * effects[1], 0.1 * effects[1]]]
    flights = MadeUp({"mass": 1.4, "damping": 1.8}, mixed=same, noise=10.0)

    ((name, (_, low, high)),) = of_log._fitted(flights).items()

    factor = of_log.FACTORS[told]
    assert name == told
    assert low < factor.nominal + factor.size * (2.0 + 0.3 * 0.995 * 2.0) < high
    (said,) = flights.notes
    assert f"{title} the model's: its interval at 95 %, {range_}, holds 1" in said


def test_nothing_is_told_of_a_log_that_is_noise():
    flights = MadeUp({"mass": 1.0, "wind_east": 0.0}, noise=100.0)

    assert found(flights) == {}
    assert len(flights.notes) == 2
    assert all("and is too wide" in said for said in flights.notes)


def test_factors_at_an_end_of_their_range_are_left_one_by_one():
    """Mass and damping act against each other, so that both are best at an end; alone, only mass.

    A wind with a hundred times their effect stays.
    """
    truth = {"mass": 1.0 + 0.2 * 16.0, "damping": 1.0 + 0.4 * 16.0, "wind_north": 4.0}
    flights = MadeUp(truth, mixed=[[1, 0, 0], [-0.9, 0.4, 0], [0, 0, 100]])
    alone = MadeUp({"mass": 4.0, "damping": 9.0})

    values = found(flights)

    ways, log = flights.ways[1:], np.array([*flights.logged.values()])
    scaled = np.array([log[i] / of_log.SCALES[x] for i, x in enumerate(("phi", "n_z"))])
    columns = ways[..., COUNTED].reshape(2, -1).T
    damping, wind = np.linalg.lstsq(columns, scaled[..., COUNTED].ravel())[0]
    assert values == pytest.approx(
        {"damping": 1.0 + 0.4 * damping, "wind_north": 5.0 * wind}, abs=ENDED
    )
    (said,) = flights.notes
    assert "mass over the model's: the best fit is at an end of its range, 0.3 to 3;" in said
    assert found(alone) == {}
    assert [said.split()[4] for said in alone.notes] == ["mass", "damping"]


def test_a_factor_that_has_an_effect_near_its_nominal_value_alone_is_left():
    """From there, the fit takes it to where it has none, and would go to and fro."""

    def effect(scaled):
        return np.array([np.interp(scaled[0], [0.0, 1.0, 1.9], [0.0, 1.0, 2.2]), *scaled[1:]])

    truth = {"mass": 1.45, "wind_east": 3.0, "damping": 0.5}
    flights = MadeUp(truth, effect=effect, mixed=np.diag([1.0, 100.0, 100.0]))

    values = found(flights)

    assert values == pytest.approx({"wind_east": 3.0, "damping": 0.5}, rel=1e-3)
    (said,) = flights.notes
    assert said.startswith("The log cannot identify mass")


def test_steps_that_make_a_fit_worse_are_halved_and_one_that_never_ends_is_rough():
    """Newton's method leaves the root of an arctangent from beyond 1.39 of its width."""
    far, steep = (MadeUp({"mass": 1.0 + 0.2 * x}, effect=e) for x, e in ARCTANGENTS)

    assert found(far) == pytest.approx({"mass": 1.29}, abs=2e-3)
    assert not far.notes
    of_log._fitted(steep)
    assert steep.notes == ["The fit still moved after 12 steps: its factors are rough."]
