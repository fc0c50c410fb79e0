"""Whether a campaign may be flown into a folder, and what of it is there already."""

from collections.abc import Callable

from flighttune.campaign.dataset.dataset import CAMPAIGN, RUNS, Dataset, open_dataset
from flighttune.campaign.dataset.storage import Store
from flighttune.campaign.engine.progress import Tally
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import InputError, RecordingError
from flighttune.one_flight import library_versions


def started(store: Store, plan: Plan, *, resume: bool) -> Dataset:
    """The folder of a campaign with its ``campaign.json``, new or to be flown on.

    Parameters
    ----------
    store : Store
        Where it is.
    plan : Plan
        What is to be flown.
    resume : bool
        Whether a campaign that is there shall be flown on.

    Raises
    ------
    InputError
        If there is a campaign and it is not to be flown on, or cannot: it is another one, was
        flown with other libraries, or cannot be made longer.
    """
    versions = library_versions()
    if not store.exists(CAMPAIGN):
        if store.names(RUNS):
            raise InputError(f"{store.url}: must be empty, got {RUNS}/ without {CAMPAIGN}.")
        dataset = Dataset(store, plan, versions)
        dataset.write_plan()
        return dataset
    found = open_dataset(store.url)
    if not resume:
        raise InputError(
            f"{store.url}: must not hold a campaign, got one of {found.plan.runs} runs; go on with "
            "it by --resume, or give another --out."
        )
    plan = plan.with_gains_of(found.plan)
    changed = found.plan.with_runs(plan.runs).differences(plan)
    if changed:
        raise InputError(f"{store.url}: holds another campaign: {'; '.join(changed)}.")
    other = [
        f"{name}: was {was}, is {versions.get(name)}"
        for name, was in found.versions.items()
        if versions.get(name) != was
    ]
    if other:
        raise InputError(
            f"{store.url}: was flown with other libraries, rows of these would not be the same: "
            f"{'; '.join(other)}."
        )
    _check_length(found, plan)
    if plan.runs != found.plan.runs:
        found = Dataset(store, plan, versions)
        found.write_plan()
    return found


def counted(dataset: Dataset, told: Callable[[str], None]) -> Tally:
    """Count what is there. Files that are damaged are removed: their runs are missing then.

    Parameters
    ----------
    dataset : Dataset
        A campaign that was begun.
    told : callable
        Gets a sentence about each file removed.

    Raises
    ------
    OutputError
        If one cannot be removed.
    """
    tally = Tally()
    for span in dataset.spans:
        try:
            tally.add(dataset.read_part(span))
        except RecordingError as error:
            told(f"{error} Its runs are flown again.")
            dataset.remove_part(span)
    return tally


def _check_length(found: Dataset, plan: Plan) -> None:
    was, now = found.plan.runs, plan.runs
    if now < was:
        raise InputError(f"{found.url}: `runs` of a campaign can only grow, was {was}, is {now}.")
    if now > was and not plan.extendable:
        raise InputError(
            f"{found.url}: `runs` must stay {was}, got {now}: the draws of a "
            f"{plan.campaign.design} design depend on their number."
        )
