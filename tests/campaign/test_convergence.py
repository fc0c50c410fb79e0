"""Estimates from the first flights on."""

import numpy as np
import pytest
from made_up_campaign import made_up_plan, made_up_rows
from scipy import stats

from flighttune.campaign.statistics.flights import flights_of
from flighttune.campaign.statistics.summary import convergence, prefixes


@pytest.mark.parametrize("n", [40, 200, 100_000])
def test_prefixes_rise_to_all_flights_in_equal_factors(n):
    found = prefixes(n)

    assert found[0] == 10
    assert found[-1] == n
    assert found == sorted(set(found))
    assert len(found) <= 25
    if n > 10_000:
        assert np.ptp(np.diff(np.log(found))) < 0.1


def test_each_point_is_what_the_first_flights_tell(tmp_path):
    plan = made_up_plan(tmp_path)
    flown = flights_of(made_up_rows(plan), plan)

    found = convergence(flown, "chi.ITAE")

    for one, (group, rows) in zip(found, flown.groups(), strict=True):
        assert one.group == group
        for n, success, p95 in zip(one.n, one.success, one.p95, strict=True):
            first = rows.head(n)
            expected = stats.binomtest(int(first["success"].sum()), n)
            assert success.lo == pytest.approx(expected.proportion_ci(method="wilson").low)
            completed = first[first["status"] == "completed"]["chi.ITAE"]
            assert p95.value == pytest.approx(np.quantile(completed, 0.95))
            assert p95.n == len(completed)
