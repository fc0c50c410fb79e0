"""Claims from files: tubes, which are proven, and bands, which are counted."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from flighttune.campaign.band import axis_of, difference, load_band, plan_of, wind_at_start
from flighttune.claims.band import Band, is_band_file
from flighttune.claims.conformance import load_conformance
from flighttune.errors import InputError
from flighttune.scenario.load import scenario_from
from flighttune.simulate.bounds import Kind, RunClaim
from flighttune.simulate.run import Run
from flighttune.tubes.enclosure import Tube
from flighttune.tubes.proof import is_tube_file, load_tube


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandClaim:
    """The claim of a band about the flights of its campaign."""

    band: Band

    kind: ClassVar[Kind] = "counted"

    @property
    def sentence(self) -> str:
        """The claim in words."""
        return self.band.sentence

    def why_not(self, run: Run) -> str:
        """Why the band says nothing of a run; empty if its flights could have been this one.

        It may differ from them in keys that they draw, whatever its value, and in its wind, gust,
        turbulence and disturbance.
        """
        if not self.band.claims:
            return "nothing is claimed: too many of the flights counted were not completed"
        differs = difference(plan_of(self.band), run, scenario_from(dict(run.provenance.scenario)))
        return f"its {differs} must be that of the flights counted" if differs else ""

    def on(self, run: Run) -> RunClaim:
        """The bounds of the signals at the samples of a run."""
        about, scenario = self.band.about, scenario_from(dict(run.provenance.scenario))
        wind = np.array(wind_at_start(scenario)) if about.predicted_from else None
        return RunClaim(
            kind=self.kind,
            title="counted band",
            sentence=self.sentence,
            bounds=self.band.bounds(axis_of(run), wind),
            units=about.signals,
        )


def load_claim(path: str | Path, conformance: str | Path | None = None) -> Tube | BandClaim:
    """Read a claim about flights, whatever its kind.

    The scale of a band is computed again from its flights; a tube is not proven again, as
    `verify` does.

    Parameters
    ----------
    path : str or Path
        A file of a tube or of a band; which one it is, is read from its content.
    conformance : str or Path, optional
        File of `flighttune conform` that confirms the boxes of an aircraft's tube.

    Returns
    -------
    Tube or BandClaim

    Raises
    ------
    InputError
        If there is no such file, or it does not support what it claims.

    Examples
    --------
    >>> tube = ft.tube("paper", "paper", changes={"flight.duration_s": 2.0})
    >>> ft.save_tube(tube, "tube.npz")
    >>> ft.load_claim("tube.npz").status
    'bounded'
    """
    path = Path(path)
    if is_band_file(path):
        return BandClaim(band=load_band(path))
    if not is_tube_file(path):
        raise InputError(f"{path}: must be the file of a tube or of a band, got another.")
    return load_tube(path, None if conformance is None else load_conformance(conformance))


def is_claim_file(path: str | Path) -> bool:
    """Whether a file is that of a tube or of a band, by its content."""
    return is_band_file(path) or is_tube_file(path)
