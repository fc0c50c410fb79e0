"""Steps of compiled flights in plain Python: winds, changes and the envelope, by hand."""

import math

import numpy as np
import pytest

from flighttune.flight.loop import batch, compiled
from flighttune.vehicles.plants import weather

FT = 0.3048
RATE, GROUND = 200.0, 100.0
LEVELS = [[200.0, 1.0, 2.0, 0.5], [400.0, 3.0, -2.0, 0.0], [600.0, 9.0, -1.0, 1.0]]
SWING = [1.0, -2.0, 0.5, 0.25, 3.0, -1.0, 0.7, 1.3]
ROUNDING = 1e-12


def motion(**changes):
    """A flight of four signals in wind that changes with height and time."""
    none = np.zeros(0)
    of = batch.Motion(
        states=np.zeros(3), parameters=np.zeros(5), shown=np.zeros(8), signals=4, further=0,
        commands=(), steps=4, between=4, low=none, high=none, weight=1.0, floor=-math.inf,
        ceiling=math.inf, stream=np.zeros((3, 0)), random=np.zeros(1, dtype=np.int64),
        errors=none, error_places=(), change_at=np.zeros(0, dtype=np.int64),
        change_place=np.zeros(0, dtype=np.int64), change_to=none,
        changed=np.zeros(1, dtype=np.int64), levels=np.array(LEVELS), swing=np.array(SWING),
        wind_places=(4, 0, 2), wind=np.zeros(7), ground=GROUND, rate=RATE,
    )  # fmt: skip
    return of._replace(**changes)


@pytest.mark.parametrize("swing", [SWING, []])
@pytest.mark.parametrize("h", [50.0, 200.0, 250.0, 400.0, 599.0, 600.0, 2000.0])
def test_the_wind_of_a_moment_is_that_of_the_weather(h, swing):
    """Heights are above the ground and in feet, and so is the wind a second."""
    (a, b, w_a, w_b) = SWING[:3], SWING[3:6], SWING[6], SWING[7]
    oscillation = weather.OscillatingWind(cosine=a, sine=b, cosine_omega=w_a, sine_omega=w_b)
    air = weather.Weather(
        wind=weather.WindProfile(tuple((row[0], tuple(row[1:])) for row in LEVELS)),
        oscillation=oscillation if swing else None,
    )

    found = compiled._wind_at(motion(swing=np.array(swing)), 2.5, (h - GROUND) / FT)

    assert np.array(found) * FT == pytest.approx(air.deterministic(2.5, h), abs=ROUNDING)


def test_the_wind_of_a_step_lies_between_those_of_every_fourth_at_the_height_to_come():
    """The aircraft climbs by 8 ft in four steps, then by 2; each climb is expected to go on."""
    h = 500.0
    flight = motion()
    flight.wind[:3] = compiled._wind_at(flight, 0.0, h)
    flight.wind[6] = h
    met = [flight.wind[:3].copy()]

    for step in range(12):
        flight.shown[4 + batch.HEIGHT] = {0: h, 4: h + 8.0, 8: h + 10.0}.get(step, math.nan)
        compiled._blow(flight, step)
        met.append(flight.parameters[[4, 0, 2]].copy())

    ends = [
        compiled._wind_at(flight, 4 * k / RATE, x) for k, x in enumerate((h, h, h + 16, h + 12))
    ]
    for j, wind in enumerate(np.array(met).T):
        at = np.interp(np.arange(13), [0, 4, 8, 12], [end[j] for end in ends])
        assert wind == pytest.approx(at, abs=ROUNDING)
    assert not flight.parameters[[1, 3]].any()


def test_changes_are_made_once_before_the_step_they_are_due_at():
    flight = motion(
        change_at=np.array([0, 3, 3, 8]), change_place=np.array([1, -2, 0, 2]),
        change_to=np.array([5.0, 6.0, 7.0, 8.0]), parameters=np.zeros(3),
    )  # fmt: skip
    made = []

    for now in (0, 2, 3, 9):
        compiled._change(flight, now)
        made.append((int(flight.changed[0]), flight.parameters.tolist(), flight.states.tolist()))
        flight.parameters[1] = 0.0

    assert made == [
        (1, [0.0, 5.0, 0.0], [0.0] * 3),
        (1, [0.0] * 3, [0.0] * 3),
        (3, [7.0, 0.0, 0.0], [0.0, 6.0, 0.0]),
        (4, [7.0, 0.0, 8.0], [0.0, 6.0, 0.0]),
    ]


@pytest.mark.parametrize("x", [0.0, -0.3, math.pi, -math.pi, 3.5, -4.0, 6.2, 11.0, -40.0, 1e3])
def test_a_remainder_is_that_of_python_to_the_bit(x):
    assert compiled._remainder(x) == math.remainder(x, math.tau)
    assert math.copysign(1.0, compiled._remainder(-x)) == -math.copysign(
        1.0, compiled._remainder(x)
    )


LOW, HIGH = (-0.1, 50.0, -200.0, -0.5), (0.3, 90.0, 900.0, 0.6)


@pytest.mark.parametrize("place", range(4))
def test_a_flight_is_inside_its_envelope_strictly_between_all_bounds(place):
    m = 12
    places = batch.ALPHA, m + batch.V_FPS, m + batch.LIFT, batch.THETA
    shown = np.full(m + 4, np.nan)
    shown[[*places]] = [0.1, 70.0, 300.0, 0.0]
    assert compiled._inside(shown, m, LOW, HIGH)

    for bound in (LOW[place], HIGH[place], math.nan):
        shown[places[place]] = bound
        assert not compiled._inside(shown, m, LOW, HIGH)


def test_steps_go_as_far_as_the_next_change_or_are_one_each_in_wind_that_changes():
    """Each call has a number of steps, and 1 if it shows the signals of the envelope."""

    def pieces(n, clock=0, **changes):
        told, drawn = [], []

        def step(states, parameters, some, stream, shown, show):
            told.append((some, show))

        changing = {"change_at": np.array([5, 7]), "change_place": np.zeros(2, dtype=np.int64)}
        changing |= {"change_to": np.zeros(2), "levels": np.zeros((0, 4))}
        flight = motion(**changing | changes)
        compiled._advance(step, lambda _, count, __: drawn.append(count), flight, clock, n)
        return told, drawn

    assert pieces(10) == ([(5, 0), (2, 0), (3, 1)], [])
    assert pieces(4, clock=6) == ([(1, 0), (3, 1)], [])
    turbulent = {"stream": np.zeros((3, 4))}
    assert pieces(8, clock=7, **turbulent) == ([(3, 0), (3, 0), (2, 1)], [12, 12, 8])
    windy = {"levels": np.array(LEVELS), "swing": np.zeros(0)}
    assert pieces(6, clock=1, **windy)[0] == [(1, 0), (1, 0), (1, 1), (1, 0), (1, 0), (1, 1)]
    sensed = {"errors": np.arange(20.0).reshape(10, 2), "error_places": (3, 1)}
    assert pieces(2, **sensed)[0] == [(1, 0), (1, 1)]
