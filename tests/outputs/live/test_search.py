"""How far a search of the page is, and that it stops where its window asks."""

from collections import Counter

import pytest

from flighttune.base.errors import StoppedError
from flighttune.campaigns.engine.progress import CampaignProgress
from flighttune.outputs.live.desk import Search


@pytest.mark.parametrize(("completed", "runs", "part"), [(30, 40, 0.75), (0, 0, 0.0), (9, 6, 1.0)])
def test_a_search_shows_the_share_of_its_flights_and_at_most_all(completed, runs, part):
    search = Search("meet", "one")
    begun = search.state

    search.see(CampaignProgress(doing="flying", runs=runs, statuses=Counter(completed=completed)))

    assert begun == {"doing": "meet", "window": "one", "said": "starting", "part": 0.0}
    assert search.state["part"] == part
    assert (search.state["doing"], search.state["window"]) == ("meet", "one")
    assert f"{completed} of {runs}" in search.state["said"]


def test_a_search_goes_on_until_it_is_stopped():
    search = Search()
    search.go_on()
    search.show("found.", done=True)
    assert (search.state["part"], search.state["done"]) == (1.0, True)
    search.stopped = True

    with pytest.raises(StoppedError):
        search.go_on()
