"""The basis of items, claims and errata, computed once on demand."""

from dataclasses import dataclass
from functools import cached_property, partial

import pandas as pd

from flighttune.control.gains import PAPER_EPSILON, PAPER_GAINS, PIGains, shifted
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel, closed_loop, kinematic_model
from flighttune.control.theory.indicators import Indicators, indicators
from flighttune.control.tuning import result, tune
from flighttune.control.tuning.problem import TuningProblem
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.duffing import DuffingCases
from flighttune.studies.paper.flight import PaperFlight, fly

# The gain sets in the order of the paper's epsilon.
ORDER = ("K1", "K2", "K3", printed.STAR, "K4", "K5", "K6")


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """The paper's experiments with one gain set in place of K*."""

    star: PIGains = PAPER_GAINS  # the judged gains, by default the printed K*

    @cached_property
    def model(self) -> LinearModel:
        """The error dynamics at the printed equilibrium."""
        return kinematic_model(V_a=printed.V_A, gamma=printed.GAMMA_C, g=printed.G)

    @cached_property
    def gains(self) -> dict[str, PIGains]:
        """K1 to K6 and K*, in the order `ORDER`."""
        return {name: shifted(self.star, PAPER_EPSILON.get(name, 0.0)) for name in ORDER}

    @cached_property
    def indicators(self) -> dict[str, Indicators]:
        """Indicators of each gain set."""
        return {name: indicators(closed_loop(self.model, K)) for name, K in self.gains.items()}

    @cached_property
    def flights(self) -> dict[str, PaperFlight]:
        """The manoeuvre with each gain set and the disturbance of Table 1."""
        wave = printed.disturbance(printed.PRINTED_DISTURBANCE)
        return {name: fly(gains, wave) for name, gains in self.gains.items()}

    @cached_property
    def undisturbed(self) -> PaperFlight:
        """The manoeuvre with K* in calm air."""
        return fly(self.star, None)

    @cached_property
    def disturbed(self) -> dict[str, PaperFlight]:
        """The manoeuvre with K* under d1 to d9, beyond the printed 20 s."""
        return {
            name: fly(self.star, printed.disturbance(name), duration=printed.AFTERWARDS)
            for name in printed.TABLE_3
        }

    @cached_property
    def readings(self) -> dict[str, PaperFlight]:
        """The manoeuvre with K* under each reading of the limits."""
        flown = partial(fly, self.star, printed.disturbance(printed.PRINTED_DISTURBANCE))
        table = printed.printed_limits()
        return {
            "ranges only": self.flights[printed.STAR],
            "ranges and rate limits": flown(limits=table),
            "with rate limits and anti-windup": flown(limits=table, conditional=True),
            "no limits": flown(limits=Limits.none(2)),
        }

    @cached_property
    def constrained(self) -> result.TuningResult:
        """Result of the optimisation model of section 4.4 with all printed constraints."""
        problem = TuningProblem(
            model=self.model,
            I_star=printed.I_STAR,
            limits=printed.printed_limits(),
            x_0=printed.E_0,
            dt=printed.OPTIMISATION_DT,
        )
        return tune.tune_problem(problem)

    @cached_property
    def optimum(self) -> result.TuningResult:
        """Result of the model without the input constraints."""
        return tune.tune_problem(TuningProblem(model=self.model, I_star=printed.I_STAR))

    @cached_property
    def duffing(self) -> DuffingCases:
        """The experiments on the Duffing oscillator."""
        return DuffingCases()

    @cached_property
    def by_gains(self) -> pd.DataFrame:
        """Measures of `flights`: index (gain set, channel)."""
        return pd.concat({name: flight.measures for name, flight in self.flights.items()})

    @cached_property
    def by_disturbance(self) -> pd.DataFrame:
        """Measures of `disturbed` over the printed 20 s: index (disturbance, channel)."""
        return pd.concat({name: flight.measures for name, flight in self.disturbed.items()})

    def of_gains(self, channel: str, measure: str) -> pd.Series:
        """One measure of one channel over the gain sets, by R_K from high to low."""
        return self.by_gains.xs(channel, level=1)[measure].loc[self.from_high_to_low]

    def of_disturbances(self, channel: str, measure: str) -> pd.DataFrame:
        """One measure of one channel: index L_d, columns omega_d."""
        table = pd.DataFrame.from_dict(printed.TABLE_3, orient="index", columns=["L_d", "omega_d"])
        # This measure is the largest magnitude after the printed 20 s.
        if measure == "after":
            values = [flight.after(channel, printed.DURATION) for flight in self.disturbed.values()]
        else:
            values = self.by_disturbance.xs(channel, level=1)[measure]
        return table.assign(value=values).pivot(index="L_d", columns="omega_d", values="value")

    def growth_of_ST(self, channel: str) -> float:
        """Largest change of ST of a channel from the smallest L_d to the largest, rad."""
        table = self.of_disturbances(channel, "ST_rad")
        return float((table.iloc[-1] - table.iloc[0]).abs().max())

    def indicator(self, name: str) -> pd.Series:
        """R_K, I_K, E_K or spectral_abscissa of each gain set."""
        return pd.Series({key: float(getattr(row, name)) for key, row in self.indicators.items()})

    @cached_property
    def from_high_to_low(self) -> list[str]:
        """The gain sets by R_K."""
        return [*self.indicator("R_K").sort_values(ascending=False, kind="stable").index]


def rank_correlation(x: pd.Series, y: pd.Series) -> float:
    """Spearman's rank correlation of two series with one index; 0 if one is constant."""
    if min(x.nunique(), y.nunique()) < 2:
        return 0.0
    return float(x.corr(y, method="spearman"))
