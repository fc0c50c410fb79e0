"""What `flighttune reproduce` leaves, made once for all tests of the paper."""

from types import MappingProxyType

import pandas as pd
import pytest
from commands import answer


class Made:
    """Values of items and claims by name, and the tables in the folder."""

    def __init__(self, folder, *names):
        self.folder = folder
        self.answer = MappingProxyType(answer("reproduce", *names, "--out", folder))
        self.values = {item["name"]: item["values"] for item in self.answer["items"]}
        self.claims = {claim["id"]: claim for claim in self.answer["claims"]}

    def table(self, name):
        return pd.read_csv(self.folder / f"{name}.csv")


@pytest.fixture(scope="session")
def make(tmp_path_factory):
    """Reproduce items and claims by name, each group of them once."""
    known = {}

    def made(*names):
        if names not in known:
            known[names] = Made(tmp_path_factory.mktemp("reproduced"), *names)
        return known[names]

    return made
