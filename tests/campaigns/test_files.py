"""Campaign files: what they put into a scenario, and how a wrong one is refused."""

import json
from pathlib import Path

import pytest
import tomlkit

import flighttune as ft
from flighttune import load_scenario

ROOT = Path(__file__).parents[2]
HEAD = 'title = "t"\nscenario = "level_turn"\nruns = 10\n'


def spelled(value):
    return json.dumps(value).replace("NaN", "nan")


def disperse(key, distribution="uniform", **keys):
    if distribution == "uniform":
        keys = {"lower": 1.0, "upper": 2.0, **keys}
    told = {"key": key, "distribution": distribution, **keys}
    lines = (f"{name} = {spelled(value)}" for name, value in told.items())
    return "\n".join(("[[disperse]]", *lines, ""))


def correlation(*keys, rank=0.5):
    return f"[[correlation]]\nkeys = {json.dumps(keys)}\nrank = {rank}\n"


SPEED = disperse("flight.V_a_mps", lower=24.0, upper=26.0)
MEDIANS = [
    (disperse("flight.V_a"), "`V_a` is not a known key; did you mean `V_a_mps`?"),
    (disperse("flight.V_a_mps"), r"must lie in 15 to 45 m/s .*got 1.5 m/s."),
    (disperse("controller.anti_windup"), "'conditional' .* got 1.5"),
    (disperse("plant[kinematic].airframe.mass_factor"), "`airframe` must be given with kind"),
]  # fmt: skip
"""What the scenario refuses of the median of a dispersion."""

CORRELATIONS = [
    (correlation("flight.V_a_mps", "flight.h_m"), "got 'flight.h_m' with none"),
    (correlation("flight.V_a_mps", "flight.V_a_mps"), "`keys` must be two"),
    (disperse("flight.h_m", "grid", values=[500.0]) + correlation("flight.V_a_mps",
     "flight.h_m"), "got 'flight.h_m' with grid"),
    (disperse("flight.h_m", lower=400.0, upper=500.0)
     + correlation("flight.V_a_mps", "flight.h_m")
     + correlation("flight.h_m", "flight.V_a_mps", rank=0.2), "each pair given once"),
]  # fmt: skip


@pytest.fixture
def load(tmp_path):
    def load(text):
        file = tmp_path / "campaign.toml"
        file.write_text(text)
        return ft.load_campaign(file)

    return load


def test_the_example_of_the_page_is_a_campaign(load):
    text = (ROOT / "docs/campaigns.md").read_text()
    campaign = load(text.split("```toml\n")[1].split("```")[0])

    assert campaign.keys == ("plant.airframe.mass_factor", "wind.speed_mps", "wind.from_deg")
    assert campaign.nominal.flight.duration_s == 15.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('title = "t"\nruns = 1\n', "`scenario` must be given."),
        ('title = "t"\n[flight]\nV_a_mps = 25.0\n', "must be a campaign, got a scenario"),
        (
            'title = "t"\nscenario = "nope"\nruns = 1\n',
            "`scenario` must be a file beside the campaign or one of .*paper.*, got 'nope'.",
        ),
        ('title = "t"\nscenario = "paper"\n', "`runs` must be given: only `design`"),
        (HEAD + 'design = "grid"\n' + SPEED, "`design` must not be 'grid' where no"),
        (HEAD + 'gains = ["paper", "K9"]\n', "`gains` must be one of tuned, paper, .*, got 'K9'."),
        (HEAD + "overrides.flight.V_a_mps = 1.0\n", r"\[flight\] `V_a_mps` must lie in 15 to 45"),
        (HEAD + '[overrides]\n"limits.phi_deg[2]" = 1.0\n', r"\[overrides\] `limits.phi_deg\[2\]`"),
        (HEAD + '[keep]\nworst_by = "ITAE"\n', r"\[keep\] `worst_by` must be one of chi.ITAE, "),
        (HEAD + '[[success]]\ngains = "K1"\nat_most.chi.ITAE = 3.0\n', "`gains` of .* got 'K1'."),
        (HEAD + '[[disperse]]\ndistribution = "uniform"\n', "`key` must be given."),
        (HEAD + f'[overrides]\n"flight{20000 * ".x"}" = 1.0\n', "must be names joined by"),
        *((HEAD + tables, f"median .*{says}") for tables, says in MEDIANS),
        *((HEAD + SPEED + tables, rf"\[+correlation\]+ .*{says}") for tables, says in CORRELATIONS),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(load, tmp_path, text, says):
    with pytest.raises(ft.ScenarioError, match=rf"^{tmp_path}/campaign\.toml: .*{says}") as caught:
        load(text)

    assert "\n" not in str(caught.value)


def test_a_campaign_is_no_scenario():
    with pytest.raises(ft.ScenarioError, match=r"first_campaign\.toml: .* got a campaign"):
        ft.load_scenario(ROOT / "scenarios/campaigns/first_campaign.toml")


@pytest.mark.parametrize(
    ("tables", "key", "says"),
    [
        (disperse("reference.chi_deg[3].rate_dps"), "reference.chi_deg[3].rate_dps", "0 to 0"),
        (disperse("plant.wings"), "plant.wings", "must be a key of a plant that flies"),
        (disperse("plant[1].kind", "choice", values=["kinematic"]), "plant[1].kind",
         r"must not be dispersed: give each plant in a \[\[plant\]\]"),
        (disperse("plant.name", "choice", values=["a"]), "plant.name", "must not be dispersed"),
        (disperse("gains"), "gains", "must not be dispersed: give each gain set in `gains`"),
        (disperse("seed"), "seed", "must not be dispersed: it is the same for all draws"),
        (disperse("flight.n_z", acts="adds"), "flight.n_z", "must be a number .* got nothing"),
        (SPEED + SPEED, "flight.V_a_mps", "must be dispersed once, but `flight.V_a_mps` means it"),
        (disperse("reference.chi_deg[0].rate_dps") + disperse("reference.chi_deg"),
         "reference.chi_deg", r"must be dispersed once, but `reference.chi_deg\[0\].rate_dps`"),
        (disperse("reference.chi_deg") + disperse("reference.chi_deg[0].rate_dps"),
         "reference.chi_deg[0].rate_dps", "must be dispersed once, but `reference.chi_deg` means"),
        (disperse("plant.throttle_max", upper=1.0, lower=0.5) + disperse("plant[1].throttle_max"),
         "plant[1].throttle_max", "must be dispersed once, but `plant.throttle_max` means it too"),
        (disperse("flight.h_m", "normal", mean=1.0, sd=1.0, lower=40.0), "flight.h_m",
         "`mean` must lie within 8 `sd`"),
        (disperse("flight.h_m", lower=2.0), "flight.h_m", "`lower` must be below `upper`, got 2"),
        (disperse("flight.h_m", "choice", values=[1.0, "a"]), "flight.h_m", "must be all numbers"),
        (disperse("flight.h_m", "choice", values=[1.0], weights=[1.0, 2.0]), "flight.h_m",
         "`weights` must be as many numbers as `values`, 1, "),
        (disperse("flight.h_m", "grid", lower=1.0, upper=2.0), "flight.h_m", "`values` must be"),
        (disperse("flight.h_m", "grid", values=[1.0], count=3), "flight.h_m", "in their place"),
    ],
)  # fmt: skip
def test_a_wrong_dispersion_is_refused_in_one_line_that_names_its_key(
    load, tmp_path, tables, key, says
):
    with pytest.raises(ft.ScenarioError, match=says) as caught:
        load(HEAD + tables)

    assert str(caught.value).startswith(f"{tmp_path}/campaign.toml: [[disperse]] `{key}`")
    assert "\n" not in str(caught.value)


def test_campaign_puts_its_gains_plants_and_overrides_into_the_scenario(load):
    campaign = load(
        HEAD
        + 'gains = ["K4"]\n[overrides]\nflight.duration_s = 7.0\n'
        + '"reference.chi_deg[0].rate_dps" = 4.0\nwind.speed_mps = 3.0\nwind.from_deg = 90.0\n'
        + '[[plant]]\nkind = "jsbsim"\naircraft = "aerosonde"\n'
    )
    nominal, base = campaign.nominal, load_scenario("level_turn")

    assert nominal.gains == ["K4"]
    assert [plant.label for plant in nominal.plant] == ["jsbsim:aerosonde"]
    assert nominal.flight.duration_s == 7.0
    assert nominal.reference.chi_deg[0].rate_dps == 4.0
    assert nominal.wind is not None
    assert nominal.flight.V_a_mps == base.flight.V_a_mps


@pytest.mark.parametrize(
    ("asked", "flown"), [(["mine"], ["mine", "exact:mine"]), (["exact:mine", "exact:paper"],) * 2]
)
def test_a_campaign_takes_the_gains_of_its_scenario_by_their_names(asked, flown, load, tmp_path):
    rows = {"K_P": [[1.0, 0.0], [0.0, 2.0]], "K_I": [[0.1, 0.0], [0.0, 0.2]]}
    base = load_scenario("level_turn")
    tables = base.as_dict() | {"law": ["paper", "exact"], "gains": ["paper"], "expect": []}
    tables["gains"] += [{"name": "mine", "law": "exact", **rows}]
    (tmp_path / "own.toml").write_text(tomlkit.dumps(ft.scenario_from(tables).as_dict()))

    campaign = load(f'title = "t"\nscenario = "own"\nruns = 4\ngains = {json.dumps(asked)}\n')

    assert list(campaign.nominal.gain_names) == flown
    (own,) = (x for x in campaign.nominal.gains if not isinstance(x, str))
    assert own.K_P == rows["K_P"]


def test_success_takes_the_place_of_what_the_scenario_expects(load):
    paper = 'title = "t"\nscenario = "gust_in_turn"\nruns = 10\n'
    expected = load_scenario("gust_in_turn").expect

    assert load(paper).nominal.expect == expected
    assert len(expected) == 2
    assert load(paper + 'gains = ["paper"]\n').nominal.expect == []
    ours = load(paper + "[[success]]\nat_most.chi.ITAE = 5.0\n").nominal.expect
    assert [one.at_most for one in ours] == [{"chi": {"ITAE": 5.0}}]


def test_a_scenario_beside_the_campaign_is_found(load, tmp_path):
    text = (ROOT / "scenarios/level_turn.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace("V_a_mps    = 25.0", "V_a_mps    = 26.0"))

    assert load(HEAD.replace("level_turn", "mine")).nominal.flight.V_a_mps == 26.0
    assert load(HEAD.replace("level_turn", "mine.toml")).nominal.flight.V_a_mps == 26.0


@pytest.mark.parametrize(
    ("place", "words"), [("nowhere", r"nowhere: .*list`"), (Path(), "must be a file or")]
)
def test_no_such_campaign_is_answered_with_those_there_are(place, words):
    with pytest.raises(ft.ScenarioError, match=words):
        ft.load_campaign(place)
