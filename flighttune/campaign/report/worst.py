"""The flights to look at first."""

import pandas as pd


def worst_first(rows: pd.DataFrame, measure: str, count: int) -> pd.DataFrame:
    """The completed flights with the largest values of a measure.

    Parameters
    ----------
    rows : DataFrame
    measure : str
        A column.
    count : int
    """
    known = (rows["status"] == "completed").to_numpy() & rows[measure].notna().to_numpy()
    return rows.loc[known].sort_values([measure, "run"], ascending=[False, True]).head(count)


def failures(rows: pd.DataFrame, count: int) -> pd.DataFrame:
    """Flights that were not completed, of every status in turn the first ones.

    Parameters
    ----------
    rows : DataFrame
    count : int
    """
    early = rows.loc[(rows["status"] != "completed").to_numpy()]
    turn = early.groupby("status", sort=False, observed=True).cumcount()
    return early.loc[turn.sort_values(kind="stable").index[:count]].sort_values("run")
