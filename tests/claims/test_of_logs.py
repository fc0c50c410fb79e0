"""A monitor of logs: its theorem, a fault that it finds in a simulated log, its file and page."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import answer, flighttune
from small_claims import T, band, logs
from watched import flown, stuck, turn

import flighttune as ft

RATE, SECONDS, FAULT_S = 25.0, 24.0, 15.0


@pytest.fixture(scope="module")
def noisy():
    return logs()


@pytest.fixture(scope="module")
def pushed(noisy):
    """The logs with commands of roll and a side force: three residuals, that of roll filtered."""
    rng = np.random.default_rng(6)
    forces = [0.3 + 0.2 * run.signals["phi"] + 0.1 * rng.normal(size=len(T)) for run in noisy]
    return [
        replace(run, signals=run.signals.assign(phi_cmd=np.sin(0.9 * T + i), f_y=force))
        for i, (run, force) in enumerate(zip(noisy, forces, strict=True))
    ]


def test_at_most_one_of_any_logs_alarms_by_what_all_others_teach(noisy):
    """What the claim of 1/(n + 1) rests on; here the log with the largest noise is the one."""
    alarms = [
        ft.monitor(*(log for log in noisy if log is not left)).alarm(left) is not None
        for left in noisy
    ]

    assert alarms == [False, False, False, False, True]


def test_logs_that_are_alike_once_they_have_settled_are_the_same_flight(noisy):
    """The first 8 s, in which the filters settle, are not judged."""
    of_logs, log = ft.monitor(*noisy), noisy[0]

    def learned(until_s):
        signals = log.signals.copy()
        signals.loc[log.t < until_s, "r"] += 0.1
        return of_logs.not_about(replace(log, signals=signals))

    assert learned(7.99) == learned(0.0) != ""
    assert learned(8.01) == ""


def test_a_claim_is_of_the_number_of_logs_and_says_what_is_not_watched(noisy):
    monitor = ft.monitor(*noisy)
    made = monitor.answer()
    not_watched = made.notes[1]

    assert made.values["epsilon"] == pytest.approx(1.0 / 6.0, abs=1e-12)
    assert "at most 1/6 = 0.1667" in monitor.sentence
    assert "airspeed (V_err)" in not_watched
    assert "roll (p, phi and phi_cmd)" in not_watched
    assert "turn" not in not_watched
    # 1 / (19 + 1) is 5 %, and 0.95^59 is the first power below 0.05
    assert "takes 19 logs; at a confidence of 0.95 for these limits it takes 59" in made.notes[2]


@pytest.mark.parametrize(
    ("logs", "options", "message"),
    [
        (2, {}, "`logs` must be at least 3 healthy flights, got 2."),
        (5, {"epsilon": 0.1}, "`epsilon` must be absent with logs"),
        (5, {"changes": {"flight.V_a_mps": 20.0}}, "`changes` must be absent"),
    ],
)
def test_too_few_logs_and_options_of_flights_are_refused(noisy, logs, options, message):
    with pytest.raises(ft.InputError, match=message):
        ft.monitor(*noisy[:logs], **options)


def test_a_flight_that_is_not_another_or_cannot_be_judged_is_refused(noisy, tmp_path):
    monitor, columns = ft.monitor(*noisy), {"n_z": 1.0, "q": 0.0, "elevator": 0.0}
    table = noisy[0].signals[["phi", "p", "r"]].assign(t=T, v_north=20.0, v_east=0.0, **columns)
    table[: round(6.0 * RATE)].to_csv(tmp_path / "short.csv", index=False)
    table.assign(V_a=np.maximum(0.0, T - 10.0)).to_csv(tmp_path / "standing.csv", index=False)
    short, standing = (ft.load_log(tmp_path / f"{name}.csv") for name in ("short", "standing"))

    with pytest.raises(ft.InputError, match=r"flights, got log / 1 twice"):
        ft.monitor(*noisy, noisy[1])
    table.to_csv(tmp_path / "whole.csv", index=False)
    parts = [ft.load_log(tmp_path / "whole.csv", start=start) for start in (0.0, 10.0)]
    with pytest.raises(ft.InputError, match=r"twice or parts that overlap"):
        ft.monitor(noisy[1], *parts)
    with pytest.raises(ft.InputError, match=r"short: must be at least 16 s .*, got 6"):
        ft.monitor(*noisy[1:4], short)
    with pytest.raises(ft.InputError, match=r"short: .* 8 s long, got 6"):
        monitor.alarm(short)
    with pytest.raises(ft.InputError, match="V_a, elevator, n_z, q must"):
        ft.monitor(*(replace(standing, signals=k * standing.signals) for k in (1.0, 1.1, 1.2)))


def test_parts_of_one_log_that_do_not_overlap_are_different_flights(noisy, tmp_path):
    t = np.arange(round(50.0 * RATE)) / RATE
    phi = 0.5 * np.sin(0.7 * t) + 1e-3 * t
    r = 0.5 * np.sin(phi) + 0.02 * np.random.default_rng(7).normal(size=len(t))
    table = {"t_s": t, "phi_rad": phi, "p": 0.35 * np.cos(0.7 * t), "r": r, "v_north": 20.0}
    pd.DataFrame(table | {"v_east": 0.0 * t}).to_csv(tmp_path / "long.csv", index=False)
    first, second, across = (
        ft.load_log(tmp_path / "long.csv", start=start, end=start + 20.0)
        for start in (0.0, 25.0, 10.0)
    )

    assert ft.monitor(noisy[1], first, second).epsilon == pytest.approx(0.25)
    for parts in ((first, across), (across, first), (second, across)):
        with pytest.raises(ft.InputError, match="parts that overlap"):
            ft.monitor(noisy[1], *parts)


def test_logs_without_the_signals_of_any_residual_are_told_which_are_missing(noisy):
    few = [replace(run, signals=run.signals[["phi", "p"]]) for run in noisy]

    with pytest.raises(
        ft.InputError, match=r"side force lacks f_y, roll lacks phi_cmd, turn lacks"
    ) as said:
        ft.monitor(*few)
    assert "pitch" not in str(said.value)  # it lacks two


def test_parts_of_one_flight_are_refused_under_other_names_too(noisy, tmp_path):
    table = noisy[0].signals[["phi", "p", "r"]].assign(t_s=T, v_north=20.0, v_east=0.0)
    later = table[round(4.0 * RATE) :].assign(t_s=lambda x: x["t_s"] - 4.0)
    later.rename(columns={"phi": "phi_rad"}).to_csv(tmp_path / "other.csv", index=False)

    with pytest.raises(ft.InputError, match=r"the same samples in log / 0 and log / other"):
        ft.monitor(noisy[0], noisy[1], ft.load_log(tmp_path / "other.csv"))


def test_logs_may_have_a_roll_or_half_of_their_samples_in_common(noisy):
    """The logs are different files, as those of a script that is flown again in other air are."""
    first, second, third = noisy[:3]
    same_roll = replace(second, signals=second.signals.assign(phi=first.signals["phi"]))
    half = pd.concat([first.signals[: len(T) // 2], second.signals[len(T) // 2 :]])

    for other in (same_roll, replace(second, signals=half)):
        assert ft.monitor(first, other, third).epsilon == pytest.approx(0.25)


def test_flights_without_a_file_are_told_apart_by_their_samples(noisy):
    tables = {x: y for x, y in noisy[0].provenance.scenario.items() if x != "log"}
    simulated = [
        replace(run, provenance=replace(run.provenance, scenario=tables)) for run in noisy[:3]
    ]

    assert ft.monitor(*simulated).epsilon == pytest.approx(0.25)
    with pytest.raises(ft.InputError, match="the same samples in"):
        ft.monitor(*simulated, simulated[1])


def changed(monitor, **of_log):
    """A monitor with other values of each log, which are made from the log."""
    return replace(
        monitor,
        logs=tuple(replace(x, **{key: of(x) for key, of in of_log.items()}) for x in monitor.logs),
    )


def scaled(name):
    return lambda log: (0.01 * np.array(getattr(log, name))).tolist()


def tuples(name):
    return lambda log: tuple(map(tuple, scaled(name)(log)))


def own_scaled(monitor):
    """A monitor whose logs miss less by the models that the others taught, and score less."""
    return replace(
        monitor,
        logs=tuple(
            replace(log, score=0.01 * log.score, peaks=(
                *log.peaks[:i], tuple(0.01 * np.array(log.peaks[i])), *log.peaks[i + 1 :]
            ))
            for i, log in enumerate(monitor.logs)
        ),
    )  # fmt: skip


OLD = {"digest": lambda _: "", "moments": lambda _: (), "peaks": lambda _: ()}
FORGERIES = {
    "of 0.4.0, four times": (
        lambda m: replace(changed(m, **OLD), logs=4 * changed(m, **OLD).logs), "5 among 20",
    ),
    "a log without what it holds": (
        lambda m: replace(m, logs=(*changed(m, **OLD).logs[:1], *m.logs[1:])), "numbers of logs",
    ),
    "limits and residuals": (
        lambda m: changed(m, limits=lambda x: tuple(scaled("limits")(x)), peaks=tuples("peaks")),
        "largest residuals of",
    ),
    "scores and own residuals": (lambda m: own_scaled(m), "largest residuals of"),
    "moments of fewer terms": (
        lambda m: changed(m, moments=lambda x: tuple(y[1:] for y in x.moments)),
        "numbers of logs",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("forged", "reason"), FORGERIES.values(), ids=FORGERIES)
def test_a_forged_monitor_is_not_valid_and_copies_of_a_log_count_once(
    noisy, forged, reason, tmp_path
):
    monitor = ft.monitor(*noisy)
    false = forged(monitor)
    false.save(tmp_path / "m.npz")

    said = ft.verify(tmp_path / "m.npz")

    assert not said.valid
    assert re.search(reason, said.reason)
    assert false.epsilon >= monitor.epsilon
    assert not ft.verify(false, logs=noisy).valid


@pytest.mark.parametrize(
    ("change", "logs", "said"),
    [
        ({}, 2, "`logs` must be at least 3, with the same models"),
        ({"models": lambda _: ()}, 5, "`logs` must be at least 3, with the same models"),
        (
            {"models": lambda x: tuple(replace(y, name="yaw") for y in x.models)},
            5,
            "`models` must be those that flighttune monitor takes of logs",
        ),
        (
            {"models": lambda x: tuple(replace(y, weights=y.weights[1:]) for y in x.models)},
            5,
            "a weight for each term, and positive limits",
        ),
        ({"limits": lambda _: (0.0,)}, 5, "a weight for each term, and positive limits"),
        ({"limits": lambda x: 2 * x.limits}, 5, "a weight for each term, and positive limits"),
    ],
)
def test_logs_that_no_monitor_has_are_refused(noisy, change, logs, said):
    monitor = ft.monitor(*noisy)

    with pytest.raises(ft.InputError, match=said):
        changed(replace(monitor, logs=monitor.logs[:logs]), **change)


def test_a_monitor_of_several_residuals_is_verified_and_each_is_one_that_logs_have(pushed):
    monitor = ft.monitor(*pushed)
    roll, *others = monitor.logs[0].models
    loose = replace(monitor.logs[0], models=(replace(roll, room=9.0), *others))

    assert [model.name for model in monitor.logs[0].models] == ["side force", "roll", "turn"]
    assert ft.verify(monitor).valid
    assert ft.verify(monitor, logs=pushed).valid
    with pytest.raises(ft.InputError, match="`models` must be those that flighttune monitor takes"):
        replace(monitor, logs=(loose, *monitor.logs[1:]))


def test_a_monitor_is_verified_by_what_its_file_holds_and_by_its_logs(noisy, tmp_path):
    monitor, file = ft.monitor(*noisy), tmp_path / "m.npz"
    monitor.save(file)

    alone, by_logs = ft.verify(file), ft.verify(file, logs=noisy[::-1])

    assert alone.valid
    assert by_logs.valid
    assert "only seen with the logs" in alone.answer().notes[0]
    assert "same 5 logs" in ft.verify(file, logs=noisy[:4]).reason
    for others in (noisy, noisy[1:]):
        assert "same 4 logs" in ft.verify(ft.monitor(*noisy[:4]), logs=others).reason
    assert [log.seconds for log in monitor.logs] == pytest.approx([T[-1] - 8.0] * 5)
    assert monitor.names == {run.provenance.gains_name for run in noisy}
    assert len(monitor.names) == 5
    assert answer("verify", file)["valid"]
    with pytest.raises(ft.InputError, match="got a monitor of logs"):
        ft.worst(file)
    assert answer("report", file, "--out", tmp_path / "page.html")["verdict"] == monitor.sentence


def test_a_file_of_0_4_0_is_read_and_says_what_cannot_be_checked_without_its_logs(
    noisy, pushed, tmp_path
):
    old = changed(ft.monitor(*noisy), **OLD)
    old.save(tmp_path / "m.npz")

    _, line = flighttune("verify", tmp_path / "m.npz", status=1)

    assert "not checked: the file, of flighttune 0.4.0, does not hold" in line
    assert ft.load(tmp_path / "m.npz").sentence == ft.monitor(*noisy).sentence
    assert ft.verify(tmp_path / "m.npz", logs=noisy).valid
    assert not ft.verify(changed(old, score=scaled("score")), logs=noisy).valid
    assert "same 5 logs" in ft.verify(old, logs=noisy[:4]).reason
    assert "same models" in ft.verify(old, logs=pushed).reason
    assert old.not_about(noisy[0]) == "it learned from a log of this name"


def test_a_log_that_it_learned_from_has_no_alarm(noisy):
    """It is not exchangeable with the others, and the same log under another name."""
    monitor = ft.monitor(*noisy)
    renamed = replace(noisy[4].provenance, gains_name="another")

    said = monitor.on(replace(noisy[4], provenance=renamed))

    assert said.no_claim == "it learned from this log"
    assert said.alarm is None
    others = ft.monitor(*noisy[:4])
    assert not others.on(noisy[4]).no_claim
    tables = {x: y for x, y in noisy[4].provenance.scenario.items() if x != "log"}
    simulated = replace(noisy[4], provenance=replace(noisy[4].provenance, scenario=tables))
    assert others.not_about(simulated) == "it is simulated, learned from logs of real flights"


def test_a_log_is_not_held_against_a_band_over_time(noisy, tmp_path):
    log = tmp_path / "log.csv"
    noisy[0].signals[["phi", "p", "r"]].assign(t_s=T, v_north=20.0, v_east=0.0).to_csv(log)

    with pytest.raises(ft.InputError, match=r"band.*\.npz: must be a monitor or the band of a rou"):
        ft.report(log, tmp_path / "page.html", claims=[band()])


def test_a_page_shows_each_of_two_monitors(noisy, tmp_path):
    files, page = [tmp_path / f"{n}.npz" for n in (3, 4)], tmp_path / "page.html"
    for file, n in zip(files, (3, 4), strict=True):
        ft.monitor(*noisy[:n], out=file)
    log = tmp_path / "log.csv"
    signals = noisy[4].signals[["phi", "p", "r"]].rename(columns={"phi": "phi_rad"})
    signals.assign(t_s=T, v_north=20.0, v_east=0.0).to_csv(log, index=False)

    charts = []
    for claims in (files[:1], files):
        report = ft.report(log, page, claims=claims)
        charts.append(page.read_text(encoding="utf-8").count("Largest score so far"))

    assert charts[1] == 2 * charts[0] > 0
    assert report.sections.count("Monitor") == 1
    assert ["at most 1/4" in line for line in report.summary] == [False, False, True, False, False]


def flight(draw, folder, **plant):
    """A log of a simulated flight of 24 s, as a table that `load_log` takes."""
    signals = flown(turn(SECONDS, draw, **plant)).signals
    kept = signals[["p", "r"]].assign(
        t_s=signals.index,
        phi_rad=signals["phi"],
        phi_cmd_rad=signals["phi_cmd"],
        v_north=signals["V_g"] * np.cos(signals["gamma"]) * np.cos(signals["chi"]),
        v_east=signals["V_g"] * np.cos(signals["gamma"]) * np.sin(signals["chi"]),
        v_down=-signals["V_g"] * np.sin(signals["gamma"]),
    )
    kept.to_csv(folder / f"{draw}.csv", index=False)
    return folder / f"{draw}.csv"


@pytest.mark.soak
def test_a_fault_in_a_log_alarms_when_it_began_and_the_page_says_why(tmp_path):
    healthy = [flight(draw, tmp_path) for draw in range(5)]
    broken = flight(5, tmp_path, **stuck(FAULT_S))
    file, page = tmp_path / "m.npz", tmp_path / "page.html"

    made = answer("monitor", *healthy[:4], "--out", file)
    fine = answer("report", healthy[4], "--claim", file, "--out", page)
    bad = answer("report", broken, "--claim", file, "--out", page, status=1)

    assert made["epsilon"] == pytest.approx(0.2, abs=1e-12)
    assert fine["alarms"] == [None]
    (alarm,) = bad["alarms"]
    assert FAULT_S <= alarm["at_s"] < FAULT_S + 2.0
    assert alarm["why"] in ("roll", "turn")
    assert "Alarm at" in page.read_text(encoding="utf-8")
    assert ft.load(file).alarm(ft.load_log(broken)).why == alarm["why"]


def test_a_log_is_judged_by_others_alone_and_an_alarm_takes_all_of_them(noisy):
    """The last log has three times the noise of the others: of no limit but theirs."""
    monitor, signals = ft.monitor(*noisy), noisy[4].signals
    wanted = 0.5 * np.sin(signals["phi"]) + 0.1 * signals["p"]

    def louder(noise):
        r = wanted + noise * (signals["r"] - wanted)
        return replace(noisy[4], signals=signals.assign(r=r))

    def alarm(noise):
        return monitor.alarm(louder(noise))

    assert monitor.logs[4].score == pytest.approx(0.06 / 0.022, rel=0.5)
    largest = max(log.score for log in monitor.logs)
    for i, (log, watch) in enumerate(zip(monitor.logs, monitor.watches, strict=True)):
        (peaks,) = np.transpose(log.peaks)
        limit = log.models[0].room * max(np.delete(peaks, i))
        assert (log.why, log.limits) == ("turn", (pytest.approx(limit),))
        assert log.score == pytest.approx(peaks[i] / limit)
        assert watch.half == pytest.approx([largest * limit])
    # By what the four others teach it alarms at 1.5 times its noise, with its own limit not.
    assert [alarm(noise) is not None for noise in (1.0, 1.5, 4.0)] == [False, False, True]
    # The noise grows: each of the five alarms at its own time, all of them at that of the last.
    growing = louder(8.0 * T / SECONDS)
    times = [watch.alarm(growing).at_s for watch in monitor.watches]
    assert len({*times}) > 1
    assert monitor.alarm(growing).at_s == max(times)
    score = monitor.on(growing).signals["alarm_score"]
    assert T[np.argmax(score > 1.0)] == pytest.approx(max(times))
