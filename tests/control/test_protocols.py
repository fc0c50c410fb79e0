"""A law and a plant that are nothing but classes, flown."""

import re
import sys

import numpy as np
import pytest
from plain_members import Glider, Proportional

import flighttune as ft
from flighttune.control.controller import GuardedLaw, LawError
from flighttune.flight.loop.loop import simulate

START = ft.loop.FlightCondition(V_a=25.0, h=800.0, chi=0.4, gamma=0.1)
LEVEL = ft.loop.Reference(chi=0.0, gamma=0.0)
NARROW = ft.loop.Limits(
    lower=[-0.3, 0.5], upper=[0.3, 1.5], rate_lower=[-0.5, -1.0], rate_upper=[0.5, 1.0]
)


def flown(law, plant=None, limits=None):
    law = GuardedLaw(law, limits or ft.loop.Limits.none(2))
    return simulate(plant or ft.loop.PointMassPlant(), law, LEVEL, condition=START, duration=4.0)


def test_a_plain_law_flies_a_plain_plant():
    signals, stop = flown(Proportional(), Glider())

    assert stop is None
    assert signals["chi"].iloc[-1] == pytest.approx(0.4 * (1 - 0.4 * 1.5 * 0.02) ** 200, rel=1e-9)


def test_a_law_that_does_not_limit_itself_is_told_what_does():
    with pytest.raises(ft.InputError, match=r"apply limits itself .*in GuardedLaw"):
        simulate(ft.loop.PointMassPlant(), Proportional(), LEVEL, condition=START, duration=4.0)  # pyright: ignore[reportArgumentType]


def test_everything_measured_is_at_hand_and_what_a_law_wants_recorded_is_a_column():
    law = Proportional()
    signals, _ = flown(law)
    last = signals.iloc[-1]

    assert signals["chi_seen"].tolist() == signals["chi"].tolist()
    assert law.begun is START
    for name in ("chi", "gamma", "V_a", "phi", "n_z"):
        assert getattr(law.last, name) == last[name]
    assert law.last.position == (last["north"], last["east"], last["down"])
    assert law.last.h == pytest.approx(START.h - last["down"], abs=1e-12)
    assert law.last.wind is None


def test_the_loop_limits_what_a_law_commands():
    signals, _ = flown(Proportional(), limits=NARROW)

    assert signals["phi_cmd"].abs().max() == 0.3
    assert signals["phi_unlimited"].iloc[0] == pytest.approx(-0.6)
    assert signals["phi_limited"].iloc[0] == 2.0
    assert set(signals["phi_limited"]) == {0.0, 1.0, 2.0}
    assert (np.abs(np.diff(signals["phi_cmd"])) <= 0.01 + 1e-15).all()


class Integrating(Proportional):
    """A law with a limiter of its own: its integral stands while a limit holds."""

    signals = {}  # noqa: RUF012

    def start(self, condition):
        self.integral, self.limiter = 0.0, ft.loop.CommandLimiter(NARROW, self.dt)
        self.limiter.start((condition.phi, condition.n_z_start))

    def step(self, measured, reference, t):
        error = reference.chi - measured.chi
        if not self.limiter.limited[0]:
            self.integral += 0.5 * error * self.dt
        return self.limiter.limit(1.5 * error + self.integral, 1.0)


def test_a_law_that_limits_itself_sees_what_its_limits_did():
    law = Integrating()
    signals, _ = flown(law, limits=NARROW)

    assert set(signals["phi_limited"]) == {0.0, 1.0, 2.0}
    assert signals["phi_unlimited"].iloc[0] == pytest.approx(1.5 * -0.4 + 0.5 * -0.4 * 0.02)
    before, after = (
        signals[[f"phi_{kind}", f"n_z_{kind}"]].iloc[-1].to_numpy() for kind in ("unlimited", "cmd")
    )
    assert law.limiter.excess == pytest.approx(before - after)


def faulty(at, does):
    class Faulty(Proportional):
        def step(self, measured, reference, t):
            good = super().step(measured, reference, t)
            return does(good) if t >= at - 1e-9 else good

    return Faulty()


class Mute(Exception):
    def __str__(self):
        raise RuntimeError

    __repr__ = __str__

    def fail(self):
        raise self


@pytest.mark.parametrize(
    ("does", "said"),
    [
        (lambda good: good[:2], r"`step` must return 3 numbers \(phi_cmd, .*\), got 2"),
        (lambda good: (np.nan, *good[1:]), r"`phi_cmd` must be finite, got nan"),
        (lambda good: (good[0], np.inf, 0.0), r"`n_z_cmd` must be finite, got inf"),
        (lambda good: sys.exit(3), "SystemExit: 3"),
        (lambda good: 1 / 0, r"ZeroDivisionError: .* \d+ of <lambda> in test_protocols.py\)"),
        *(
            (lambda good, odd=odd: (odd, 1.0, 0.0), r"`step` must return 3 numbers .*, got ")
            for odd in ("left", "1.0", b"1", True, np.True_, 1j, np.complex64(1), 10**5000)
        ),
        (lambda good: Mute(), r"`step` must return 3 numbers .*, got a value of type Mute\."),
        (lambda good: Mute().fail(), r"Mute: a value of type Mute \(line \d+ of "),
        (lambda good: b"\0\1\0", r"`step` must return 3 numbers .*, got b'"),
    ],
)  # fmt: skip
def test_a_law_that_fails_ends_the_flight_and_keeps_what_was_flown(does, said):
    signals, stop = flown(faulty(1.0, does))

    assert stop is not None
    assert stop.status == "law_failed"
    assert len(signals) == 50
    assert "\n" not in stop.reason
    assert re.search(rf"^law at t = 1.00 s: {said}", stop.reason)


def test_a_law_that_cannot_start_ends_the_flight_without_samples():
    class NoStart(Proportional):
        def start(self, condition):
            raise RuntimeError("no model")

    signals, stop = flown(NoStart())

    assert len(signals) == 0
    assert stop.reason.startswith("law at t = 0.00 s: RuntimeError: no model")


def test_a_law_that_takes_longer_than_the_flight_ends_it(monkeypatch):
    from flighttune.control import controller

    clock = iter(np.arange(1e4))  # every look at the clock is a second later
    monkeypatch.setattr(controller.time, "perf_counter", lambda: next(clock))
    signals, stop = flown(Proportional())

    assert stop.status == "law_failed"
    assert len(signals) == 5  # 6 s of steps in 0.1 s of flight
    assert "must not take 5 s longer than the flight, got 6.0 s" in stop.reason


def test_a_signal_that_the_plant_has_too_is_refused():
    law = Proportional()
    law.signals = {"chi": "rad"}

    with pytest.raises(LawError, match=r"`signals` must .* \['chi'\]"):
        flown(law)
