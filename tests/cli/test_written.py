"""Which files a command writes: none of a result that is worse, unsolved, unproven or missed."""

import sys
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

import flighttune as ft
from flighttune.base.files import load
from flighttune.claims import verbs, verify
from flighttune.cli import aircraft, explain, gains
from flighttune.flight import gains as flight_gains
from flighttune.outputs.answers.answer import Answer
from flighttune.outputs.answers.finding import unmet


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(folder):
    return sorted(x.relative_to(folder).as_posix() for x in folder.rglob("*") if x.is_file())


def saved(file):
    """Write a file, as results do."""
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    Path(file).write_text("saved")
    return Path(file)


def verb(made, **given):
    """A verb that the user gave these options; it returns the same for all others."""

    def call(*_, **keywords):
        call.keywords = keywords
        return made

    return partial(call, **given), call


@pytest.mark.parametrize("better", [True, False])
@pytest.mark.parametrize("out", [Path("new.params"), None])
def test_parameters_are_written_if_they_are_better(folder, better, out):
    made = SimpleNamespace(better=better, save_parameters=saved, answer=Answer)
    search, called = verb(made, autopilot="mine.params")

    said = gains.meet(search, "circuit@3", None, out)

    kept = better and out is not None
    assert written(folder) == ["new.params"] * kept
    assert said.files == {"out": out if kept else None}
    assert called.keywords["kept"] == Path("runs/circuit-searched-unfinished.jsonl")


@pytest.mark.parametrize(
    ("stated", "out", "page", "words"),
    [
        ("mine.params", "mine.params", None, "must be another file than --with"),
        ("mine.param", "new.params", None, "must end in .param or .parm"),
        ("mine.parm", "new.params", None, "must end in .param or .parm"),
        ("mine.params", "new.parm", None, "must end in .params"),
        ("mine.txt", "new.json", None, "must end in .params or .param or .parm"),
        ("mine.params", None, "page.html", "--page must be absent with --with"),
    ],
)
def test_parameters_keep_the_format_of_their_file_and_leave_it(folder, stated, out, page, words):
    search, called = verb(SimpleNamespace(better=True), autopilot=stated)

    with pytest.raises(ft.InputError, match=words):
        gains.meet(search, "circuit", page and Path(page), out and Path(out))
    assert not hasattr(called, "keywords")
    assert written(folder) == []


@pytest.mark.parametrize("solved", [True, False])
@pytest.mark.parametrize("proven", [True, False])
def test_a_tuning_writes_the_bound_that_it_proved_and_its_answer(folder, solved, proven):
    bound = SimpleNamespace(save=saved) if proven else None
    made = SimpleNamespace(solved=solved, bound=bound, answer=Answer)
    tuning, called = verb(made)

    said = gains.tune(
        tuning, "paper", {}, Path("x.json"), Path("p.json"), None, frontier=False, points=None
    )

    assert called.keywords == {"prove": True}
    assert written(folder) == ["p.json"] * proven + ["x.json"]
    assert said.files["page"] is None
    gains.tune(tuning, "paper", {}, None, None, None, frontier=False, points=None)
    assert called.keywords == {"prove": False}
    page = Path("x.html")
    if not solved:
        unsolved = gains.tune(tuning, "paper", {}, None, None, page, frontier=False, points=None)
        assert unsolved.files["page"] is None


@pytest.mark.parametrize(
    ("points", "out", "flown", "place"),
    [(None, None, 25, "runs/turn"), (7, Path("here"), 7, "here"), (7, Path("a.b"), 7, "a.b")],
)
def test_a_frontier_has_25_points_and_a_folder_by_default(monkeypatch, points, out, flown, place):
    asked = {}

    def frontier(source, **settings):
        asked[source] = settings
        return SimpleNamespace(answer=Answer, save=lambda folder: {"table": folder / "x.csv"})

    monkeypatch.setattr(flight_gains, "frontier", frontier)
    tuning, called = verb(None, changes={"seed": 3})

    said = gains.tune(
        tuning, "some/turn.toml", {"seed": 3}, out, None, None, frontier=True, points=points
    )

    assert asked == {"some/turn.toml": {"points": flown, "changes": {"seed": 3}}}
    assert said.files == {"table": Path(place) / "x.csv"}
    assert not hasattr(called, "keywords")


@pytest.mark.parametrize("out", [Path("a.json"), Path("a.csv"), Path("a.svg"), Path("there")])
def test_a_frontier_is_written_into_no_file(folder, out):
    saved(folder / "there")

    with pytest.raises(ft.InputError, match=f"{out}: `--out` must be a folder with --frontier"):
        gains.tune(verb(None)[0], "turn", {}, out, None, None, frontier=True, points=None)


@pytest.mark.parametrize(("page", "given"), [(Path("x.html"), {}), (None, {"envelope": True})])
def test_a_frontier_takes_neither_a_page_nor_settings_of_a_tuning(page, given):
    with pytest.raises(ft.InputError, match="must be absent with --frontier"):
        gains.tune(verb(None, **given)[0], "turn", {}, None, None, page, frontier=True, points=None)


def test_a_search_of_gains_writes_its_answer_as_json_alone(folder):
    search, called = verb(SimpleNamespace(answer=Answer), autopilot=None)

    said = gains.meet(search, "some/turn.toml", None, Path("g.json"))

    assert called.keywords["kept"] == Path("runs/turn-searched-unfinished.jsonl")
    assert written(folder) == ["g.json"]
    assert said.files == {"out": Path("g.json"), "page": None}
    for body in (gains.meet, partial(gains.tune, changes={}, prove=None, frontier=False)):
        options = {"points": None} if body is not gains.meet else {}
        with pytest.raises(ft.InputError, match=r"must end in \.json"):
            body(search, "turn", page=None, out=Path("g.csv"), **options)


@pytest.mark.parametrize("proven", [True, False])
def test_certify_writes_a_certificate_if_there_is_one(folder, proven):
    made = SimpleNamespace(
        certificate=SimpleNamespace(save=saved) if proven else None, answer=Answer
    )

    said = gains.certify(verb(made)[0], "paper", Path("c.json"), None)

    assert written(folder) == ["c.json"] * proven
    assert said.files == {"proof": Path("c.json") if proven else None, "figure": None}


@pytest.mark.parametrize(("missed", "dry"), [("", False), ("", True), ("slow", False)])
def test_a_design_that_misses_or_only_tries_writes_nothing(folder, missed, dry):
    made = SimpleNamespace(
        missed=missed, answer=Answer, save=lambda out: {"written": saved(out / "aircraft.toml")}
    )

    said = aircraft.design(verb(made)[0], "aerosonde", Path("mine"), dry_run=dry)

    kept = not (missed or dry)
    assert written(folder) == ["mine/aircraft.toml"] * kept
    assert (said.files["written"] is not None) == kept


@pytest.mark.parametrize("out", [None, Path("c.html"), Path("c.rrd")])
def test_runs_that_cannot_be_compared_are_not_written(folder, out):
    made = SimpleNamespace(answer=partial(Answer, findings=unmet("other aircraft", 2)))

    said = explain.compare(verb(made)[0], "a", None, out)

    assert written(folder) == []
    assert said.files == {"recording": None, "page": None}
    assert (said.failure, said.status) == ("other aircraft", 2)


@pytest.mark.parametrize("name", ["c.html", "c.HTML", "c.rrd", None])
def test_a_comparison_is_a_page_or_a_recording_by_its_ending(folder, monkeypatch, name):
    writers = {"pages.page": "write_comparison_page", "recording.record": "write_overlay"}
    for module, function in writers.items():
        made = SimpleNamespace(**{function: lambda _, out, to=function: saved(f"{to}-{out}")})
        monkeypatch.setitem(sys.modules, f"flighttune.outputs.{module}", made)
    compared = SimpleNamespace(answer=Answer)

    said = explain.compare(verb(compared)[0], "a", None, name and Path(name))

    page = name is not None and name.lower().endswith("html")
    by = "write_comparison_page" if page else "write_overlay"
    assert written(folder) == ([f"{by}-{name}"] if name else [])
    assert said.files == {
        "recording": Path(name) if name and not page else None,
        "page": Path(name) if page else None,
    }


@pytest.mark.parametrize("in_file", [True, False])
def test_boxes_of_a_file_are_read_and_not_written_again(folder, monkeypatch, in_file):
    monkeypatch.setattr(load, "kind_of", lambda _: load.BAND if in_file else "campaign")
    monkeypatch.setattr(verify, "load_residual", lambda file: f"read {file}")
    monkeypatch.setattr(verbs, "residual", lambda boxes, gains, **_: f"counted {boxes} {gains}")
    band = SimpleNamespace(save=saved)
    made = SimpleNamespace(
        status="bounded", save=saved, problem=SimpleNamespace(band=band), answer=lambda _: Answer()
    )
    enclose, called = verb(made)

    monkeypatch.setattr(explain, "flown_by", lambda: nullcontext({}))
    explain.tube(enclose, "turn", "paper", Path("t.npz"), None, "b")

    assert called.keywords["boxes"] == ("read b" if in_file else "counted b paper")
    assert called.keywords["disturbance"] is None
    assert written(folder) == ["runs/turn-boxes.npz"] * (not in_file) + ["t.npz"]


@pytest.mark.parametrize(
    ("kind", "flights", "out", "counted", "named"),
    [
        ("scenario", None, None, "runs/turn-band.npz", "runs/turn-band.npz"),
        ("scenario", 9, Path("x.npz"), "x.npz", "x.npz"),
        (load.BAND, None, None, None, None),
        (load.BAND, 9, None, None, "some/turn.npz"),
        (load.BAND, 9, Path("x.npz"), "x.npz", "x.npz"),
    ],
)
def test_a_band_is_written_where_it_was_unless_another_file_is_given(
    monkeypatch, kind, flights, out, counted, named
):
    monkeypatch.setattr(load, "kind_of", lambda _: kind)
    count, called = verb(SimpleNamespace(answer=lambda file: Answer(notes=[f"of {file}"])))

    said = explain.band(count, "some/turn.npz", flights, out)

    assert called.keywords == {"out": counted and Path(counted)}
    assert said.files == {"band": named and Path(named), "page": None}
    file = counted or "some/turn.npz"
    assert said.notes == [f"of {file}", f"A page with its flights: flighttune report {file}"]


@pytest.mark.parametrize("bounded", [True, False])
@pytest.mark.parametrize("counted", [True, False])
def test_a_tube_is_written_if_it_is_bounded_and_boxes_that_were_counted_for_it_are_too(
    folder, bounded, counted
):
    made = SimpleNamespace(
        status="bounded" if bounded else "unbounded", save=saved,
        problem=SimpleNamespace(band=SimpleNamespace(save=saved) if counted else None),
        answer=lambda gains: Answer(notes=[gains]),
    )  # fmt: skip
    enclose, called = verb(made)

    said = explain.tube(enclose, "some/turn.toml", "paper", None, "0.25", None)

    assert called.keywords == {"boxes": None, "disturbance": 0.25, "progress": None}
    files = ["runs/turn-boxes.npz"] * counted + ["runs/turn-tube.npz"] * bounded
    assert written(folder) == files
    assert said.files["proof"] == (Path("runs/turn-tube.npz") if bounded else None)
    assert ("boxes" in said.files) == counted
    assert said.notes == ["paper"]


@pytest.mark.parametrize(
    ("disturbance", "out", "words"),
    [
        ("much", None, "--disturbance: must be a number, got 'much'"),
        ("largest", Path("t.npz"), "must be a number with --boxes or --out, got largest"),
    ],
)
def test_a_disturbance_is_a_number_or_the_largest_alone(disturbance, out, words):
    with pytest.raises(ft.InputError, match=words):
        explain.tube(verb(None)[0], "turn", None, out, disturbance, None)


def test_the_worst_flight_and_a_monitor_are_written_where_they_are_asked():
    worst = SimpleNamespace(save=saved, answer=Answer)
    assert explain.worst(verb(worst)[0], Path("w.toml")).files == {"scenario": Path("w.toml")}
    assert Path("w.toml").exists()
    monitor = SimpleNamespace(answer=lambda file: Answer(notes=[str(file)]))
    said = explain.monitor(verb(monitor)[0], Path("m.npz"))
    assert (said.notes, said.files) == (["m.npz"], {"monitor": Path("m.npz")})
