"""Gains to choose from, and a campaign that flies them in place of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.campaign.planning.schema import Campaign, CertificateTable
from flighttune.control.gains import PIGains
from flighttune.errors import InputError
from flighttune.outer_loop import tuning_problem
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.tuning.frontier import frontier
from flighttune.tuning.result import assessment

NO_FLIGHT_FOR_IT = CertificateTable(L_d_rad_s2=1.0)
"""With a bound given, a campaign flies nothing to find one; nobody looks at the claim here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Gains with their place beside the frontier.

    Attributes
    ----------
    name : str
    gains : PIGains
    R_K : float, 1/s
    I_K : float, s^2
        On the model that the scenario's [tuning] names.
    """

    name: str
    gains: PIGains
    R_K: float
    I_K: float


def frontier_candidates(scenario: Scenario, count: int) -> tuple[Candidate, ...]:
    """Gains of the largest R_K for rising I_K, each once.

    Parameters
    ----------
    scenario : Scenario
        Its tuning problem gives the frontier.
    count : int
        Points of the frontier.

    Returns
    -------
    tuple of Candidate
        Named ``frontier-1`` and so on, I_K rising; empty where no stable gains lie within the
        limits of the problem.

    Raises
    ------
    InputError
        If `count` is less than 2.
    """
    problem = tuning_problem(scenario)
    inputs, errors = problem.model.inputs, problem.model.errors
    found: list[Candidate] = []
    for row in frontier(problem, points=count).to_dict("records"):
        K_P, K_I = (
            np.array(
                [[row[f"{kind}[{channel},{error}]"] for error in errors] for channel in inputs]
            )
            for kind in ("K_P", "K_I")
        )
        gains = PIGains(K_P=K_P, K_I=K_I)
        if all(gains != one.gains for one in found):
            name = f"frontier-{len(found) + 1}"
            found.append(Candidate(name=name, gains=gains, R_K=row["R_K"], I_K=row["I_K"]))
    return tuple(found)


def own_candidates(
    scenario: Scenario, gain_sets: Mapping[str, PIGains | None]
) -> tuple[Candidate, ...]:
    """The gain sets of a campaign, to be compared with; without those that tuning did not find."""
    problem = tuning_problem(scenario)
    found = []
    for name, gains in gain_sets.items():
        if gains is not None:
            one = assessment(problem, gains.K)
            found.append(Candidate(name=name, gains=gains, R_K=one.R_K, I_K=one.I_K))
    return tuple(found)


def with_gains(campaign: Campaign, gains: Mapping[str, PIGains]) -> Campaign:
    """The same campaign for other gain sets, with the same draws.

    Parameters
    ----------
    campaign : Campaign
    gains : mapping of str to PIGains
        By name. Expectations of gain sets that are not among them are left out.
    """
    tables = [
        GainsTable(name=name, K_P=one.K_P.tolist(), K_I=one.K_I.tolist())
        for name, one in gains.items()
    ]
    nominal, central = (
        scenario.model_copy(
            update={
                "gains": tables,
                "expect": [one for one in scenario.expect if one.gains in (None, *gains)],
            }
        )
        for scenario in (campaign.nominal, campaign.central)
    )
    success = [one for one in campaign.success if one.gains in (None, *gains)]
    return campaign.model_copy(
        update={
            "gains": tables, "success": success, "certificate": NO_FLIGHT_FOR_IT,
            "nominal": nominal, "central": central,
        }
    )  # fmt: skip


def on_plants(campaign: Campaign, plants: Sequence[str]) -> Campaign:
    """The same campaign on some of its plants.

    Raises
    ------
    InputError
        If it has no such plant.
    """
    labels = [plant.label for plant in campaign.nominal.plant]
    for wanted in plants:
        if wanted not in labels:
            raise InputError(f"`plant` must be one of {', '.join(labels)}, got {wanted!r}.")
    nominal, central = (
        scenario.model_copy(
            update={
                "plant": [plant for plant in scenario.plant if plant.label in plants],
                "expect": [one for one in scenario.expect if one.plant in (None, *plants)],
            }
        )
        for scenario in (campaign.nominal, campaign.central)
    )
    return campaign.model_copy(update={"plant": None, "nominal": nominal, "central": central})
