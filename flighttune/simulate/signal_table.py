"""The table of a flight: it reads like any other and takes no new column."""

from typing import Any, NoReturn

import pandas as pd


class SignalTable(pd.DataFrame):
    """A DataFrame whose columns stay what they are; everything made from it is a plain one."""

    @property
    def _constructor(self) -> type[pd.DataFrame]:
        return pd.DataFrame

    def _refused(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(
            "`signals` of a run must stay as they were flown; `run.signals.assign(...)` and "
            "`run.signals.copy()` make tables that can be changed"
        )

    __setitem__ = __delitem__ = insert = pop = _refused  # type: ignore[assignment]
    _update_inplace = _set_axis = _refused  # type: ignore[assignment]
