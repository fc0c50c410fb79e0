"""What is installed by default has licences that a company can take."""

import re
from importlib.metadata import PackageNotFoundError, distribution

from packaging.requirements import Requirement

STRONG = re.compile(r"\b(A?GPL)\b(?![\w.+ -]*(WITH[\w -]*)?GCC.exception)|Affero", re.IGNORECASE)
"""Licences that reach what links to them; the LGPL and the exception of GCC's runtime do not."""


def installed(name, seen):
    """Every distribution that a default installation of one brings."""
    try:
        found = distribution(name)
    except PackageNotFoundError:  # for another system
        return
    if found.name in seen:
        return
    seen[found.name] = found
    for line in found.requires or ():
        needed = Requirement(line)
        if needed.marker is None or needed.marker.evaluate({"extra": ""}):
            installed(needed.name, seen)


def licence_of(found):
    """What a distribution says of its licence in its metadata, without whole texts."""
    said = [found.metadata.get("License-Expression"), found.metadata.get("License")]
    said += [one for one in found.metadata.get_all("Classifier") or () if "License" in one]
    return "; ".join(one.splitlines()[0] for one in said if one and len(one) < 500)


def test_nothing_installed_by_default_is_gpl_or_agpl():
    seen = {}
    installed("flighttune", seen)
    licences = {name: licence_of(one) for name, one in seen.items()}

    assert {"jsbsim", "numpy", "scipy", "cvxpy-base", "rerun-sdk", "pandas"} <= set(licences)
    assert "LGPL" in licences["jsbsim"]  # it says it this way, so the names are read
    assert {name: said for name, said in licences.items() if STRONG.search(said)} == {}
