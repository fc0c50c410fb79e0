"""Files of claims: those of 0.3.0 say what they said, and no field of one can be made to lie."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fuzzing import marked
from made_up_tubes import claim_of, rewritten

import flighttune as ft
from flighttune.control.certificates.exact_rate import exact_rates

FILES = Path(__file__).parent / "files_of_0_3_0"

# What 0.3.0 printed of its files, in the words that both say.
SAID = {
    "certificate.json": "decays at 0.459931 1/s",
    "certificate_envelope.json": "decays at 0.17162 1/s",
    "certificate_sampled.json": "(sampled at 50 Hz) decays at 0.687588 1/s, with a growth of at "
    "most 14.9",
    "certificate_conditions.json": "decays at 0.0148446 1/s",
    "bound.json": "none exist",
    "tube.npz": "keeps χ within 0.0001 deg and γ within 0.0024 deg",
    "tube_for_ever.npz": "keeps χ within 4.4e-07 deg and γ within 0.0022 deg",
    "band.npz": "5 of 91 fresh flights",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        *marked(
            [x for x in SAID if x != "tube_for_ever.npz"],
            pytest.mark.soak,
            but=("certificate_envelope.json",),
        ),
        pytest.param("tube_for_ever.npz", marks=pytest.mark.counts),  # it takes 13 s to prove
    ],
)
def test_a_claim_of_0_3_0_is_valid_with_its_numbers(name):
    verified = ft.verify(FILES / name)

    assert verified.valid, verified.reason
    assert SAID[name] in verified.claim.sentence


def test_a_run_of_0_3_0_is_read():
    (run,) = ft.load(FILES / "run.parquet").runs

    assert (run.status, run.provenance.gains_name) == ("completed", "paper")
    assert run.signals.index[-1] == pytest.approx(1.0)


# Names and numbers that a sentence gives as those of the maker.
QUOTED = {
    *("model.states", "claim.conditions", "scenario.title"),
    # without the law's entries, the conditions are told as the maker's alone
    *("models.A", "models.B", "models.C"),
}

# Fields of which less is more: the proof holds for a narrower envelope and a larger bound too.
LESS_IS_MORE = "claim.envelope", "R_bound"

# Arrays of the set that holds for ever, which takes ten seconds to check: on a shorter tube,
# tubes/test_hand_over.py has some of them refused.
EVER = "ever_W", "ever_centre", "ever_size", "ever_bounds", "ever_chosen"

# Of these another value is proven by the same numbers: the boxes of the file refute gains with a
# larger I_K too, and with roll to both sides the largest load factor alone counts.
PROVEN_TOO = "I_star", "claim.envelope.n_z"

# What the reader of files takes; `units` are a legend for people, which nothing prints.
SKIPPED = "format", *PROVEN_TOO


def leaves(value, path=()):
    """The first leaf of every field, of every table, by its path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, (*path, key))
    elif isinstance(value, list) and value:
        # A sampled loop, which follows the continuous one, has fields of its own.
        for i, inner in enumerate(value if isinstance(value[0], dict) else value[:1]):
            yield from leaves(inner, (*path, i))
    else:
        yield path, value


def forged(value, field):
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        if field.startswith(LESS_IS_MORE):
            return 0.9 * value - 0.1
        return 1.01 * value + 0.001
    return "forged" if isinstance(value, str) else 0.5


def field_of(path):
    return ".".join(key for key in path if isinstance(key, str))


QUICK = "gains.errors", "gains.inputs"


def forgeries():
    """Each field of certificates and bounds once, and of the claim of a tube, with its file."""
    seen = set()
    for name in SAID:
        if name in ("band.npz", "tube_for_ever.npz"):
            continue
        file = FILES / name
        kind = name.split("_")[0].split(".")[0]
        tables = claim_of(file) if file.suffix == ".npz" else json.loads(file.read_text())
        for path, value in leaves(tables):
            if (
                (kind, field_of(path)) not in seen
                and field_of(path) not in SKIPPED
                and path[0] != "units"
            ):
                seen.add((kind, field_of(path)))
                # the manoeuvre of a tube: each takes a second, and makes another tube or none
                long = kind == "tube" and path[0] == "scenario"
                others = pytest.mark.counts if long else pytest.mark.soak
                marks = [others] * (field_of(path) not in QUICK)
                yield pytest.param(name, path, value, marks=marks, id=f"{kind}:{field_of(path)}")


def claim_or_none(path):
    """A claim that `verify` finds valid."""
    try:
        verified = ft.verify(path)
    except (ft.InputError, ft.RecordingError):
        return None
    return verified.claim if verified.valid else None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "path", "value"), [*forgeries()])
def test_a_forged_field_is_refused_or_no_sentence_takes_it_for_a_fact(tmp_path, name, path, value):
    file, copy = FILES / name, tmp_path / name
    copy.write_bytes(file.read_bytes())
    tables = claim_of(file) if file.suffix == ".npz" else json.loads(file.read_text())
    at = tables
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = forged(value, field_of(path))
    if file.suffix == ".npz":
        rewritten(copy, {}, **tables)
    else:
        copy.write_text(json.dumps(tables))

    claim = claim_or_none(copy)

    if claim is not None:
        true = ft.load(file)
        quotes = field_of(path) in QUOTED and "its maker" in claim.sentence
        assert quotes or claim.sentence == true.sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["bounds", "held", "chosen", *(pytest.param(x, marks=pytest.mark.counts) for x in EVER)]
)
def test_a_forged_array_of_a_tube_is_refused(tmp_path, name):
    copy = tmp_path / "tube.npz"
    copy.write_bytes((FILES / "tube_for_ever.npz").read_bytes())
    array = np.load(copy)[name]
    rewritten(copy, {name: ~array if array.dtype == bool else 0.9 * array})

    assert claim_or_none(copy) is None


def test_an_archive_that_is_cut_off_is_called_no_band(tmp_path):
    (tmp_path / "tube.npz").write_bytes((FILES / "tube.npz").read_bytes()[:300])

    with pytest.raises(ft.RecordingError, match=r"archive .* cut off"):
        ft.verify(tmp_path / "tube.npz")


def certificate_with(tmp_path, name, change):
    """The file of a certificate of 0.3.0, with a change of its tables."""
    tables = json.loads((FILES / name).read_text())
    change(tables)
    (tmp_path / "changed.json").write_text(json.dumps(tables))
    return tmp_path / "changed.json"


def units(t):
    rate = t["exact_rates"][0]
    rate["units"] = [1e3 * u if i % 2 else u for i, u in enumerate(rate["units"])]
    scale = np.array([1e3 if i % 2 else 1.0 for i in range(len(rate["units"]))])
    rate["Q"] = (np.array(rate["Q"]) * scale * scale[:, None]).tolist()


def test_units_of_a_norm_do_not_change_its_growth(tmp_path):
    """The same norm in units of a thousandth: s' Q s is the same number."""
    plain = ft.load(FILES / "certificate.json")

    other = ft.load(certificate_with(tmp_path, "certificate.json", units))

    assert other.rates_values[0]["growth"] == pytest.approx(plain.rates_values[0]["growth"])
    assert ft.verify(other).valid


PLAIN, WIDE, MANY = (f"certificate{x}.json" for x in ("", "_envelope", "_conditions"))
RATES = json.loads((FILES / PLAIN).read_text())["exact_rates"]


@pytest.mark.parametrize(
    ("name", "change", "why"),
    [
        (PLAIN, lambda t: t.update(exact_rates=RATES[:1] * 3), "then of the sampled one"),
        (PLAIN, lambda t: t["exact_rates"].reverse(), "then of the sampled one"),
        (WIDE, lambda t: t.update(exact_rates=RATES), "`exact_rates` must be empty"),
        (WIDE, lambda t: t["claim"].update(conditions=[[25.0, 0.0]]), "conditions` must be empty"),
        (WIDE, lambda t: t.pop("hull"), "`envelope` and `hull`"),
        (WIDE, lambda t: t["claim"].pop("g"), "envelope` and `g`"),
        (WIDE, lambda t: t["model"].update(states=["V", "h"]), "`states` must be chi, gamma"),
        (WIDE, lambda t: t.pop("multiplier"), "`multiplier` must be given together"),
        (MANY, lambda t: t["claim"]["conditions"][0].reverse(), "conditions` must be positive"),
        (MANY, lambda t: t["models"].pop(0), "`models` must be one a condition"),
        (MANY, lambda t: t["models"][0]["states"].reverse(), "`models` must have the states"),
    ],
)
def test_a_certificate_that_does_not_fit_together_is_refused(tmp_path, name, change, why):
    with pytest.raises(ft.InputError, match=why):
        ft.load(certificate_with(tmp_path, name, change))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "change", "why"),
    [
        (PLAIN, lambda x: {"model": replace(x.model, B=3.0 * x.model.B)}, "the model and lags"),
        (PLAIN, lambda _: {"trapezoidal": False}, "the integral"),
        ("certificate_sampled.json",
         lambda x: {"lags": tuple(lag.delayed(0.01) for lag in x.lags)}, "the model and lags"),
    ],
)  # fmt: skip
def test_a_rate_that_is_proven_of_another_loop_is_refused(name, change, why):
    """The forger proves the other loop: every inequality of its rate holds."""
    claim = ft.load(FILES / name)
    sampling = claim.exact_rates[1].sampling
    rates, _ = exact_rates(claim.model, claim.gains, sampling=replace(sampling, **change(sampling)))

    checks = ft.verify(replace(claim, exact_rates=rates)).checks

    (failed,) = (check.name for check in checks if not check.exact)
    assert failed.startswith(why)


def test_conditions_are_told_as_facts_only_where_the_models_entries_are_the_laws(tmp_path):
    def wider(t):
        t["claim"]["conditions"][0][0] = 10.0

    told = ft.load(FILES / MANY).sentence
    forged_sentence = ft.load(certificate_with(tmp_path, MANY, wider)).sentence

    assert "their entries are those of the law there, with g 9.81 m/s²" in told
    assert "which its maker states as V_a 10..30 m/s" in forged_sentence
    assert "their entries" not in forged_sentence


def test_the_checks_of_a_claim_are_those_of_its_file_where_it_has_one():
    verified = ft.verify(FILES / "certificate.json")
    of_none, of_file = (replace(verified, source=x).answer() for x in ("", "mine.json"))

    assert of_none.summary[0] == "valid: every check holds."
    assert of_file.summary[0] == "mine.json: valid: every check holds."
