"""Draw docs/sampling.png, what the controller's rate does: python docs/sampling.py."""

from pathlib import Path

from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.outer_loop import tune_scenario
from flighttune.report.identification import save_figure
from flighttune.report.sampling import sampled_steps
from flighttune.report.sampling_figure import sampling_figure
from flighttune.scenario import load_scenario

AIRCRAFT = "aerosonde"
V_A = 25.0


def gain_sets() -> dict[str, PIGains]:
    """Return the gains that are drawn, by name."""
    tuned = tune_scenario(load_scenario("paper_identified"), "identified").gains
    if tuned is None:
        raise SystemExit("no gains were found")
    return {"paper": PAPER_GAINS, "tuned_identified": tuned}


if __name__ == "__main__":
    steps = sampled_steps(AIRCRAFT, gain_sets(), V_a=V_A)
    save_figure(sampling_figure(steps), Path(__file__).with_suffix(".png"))
