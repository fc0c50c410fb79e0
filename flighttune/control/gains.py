"""Gains of the multivariable PI controller."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from pydantic import SerializerFunctionWrapHandler, model_serializer

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_positive, read_only_matrix, set_read_only
from flighttune.base.errors import InputError
from flighttune.base.files.whole import write_text
from flighttune.base.units import G_PAPER

# Inputs of the paper's law's gains.
COMMANDS = ("phi", "n_z")

# Inputs of the exact law's gains: desired rates, in place of roll and load factor.
RATES = ("chi_dot", "gamma_dot")

# Third inputs of both laws if the airspeed is a channel: longitudinal load factor, relative rate.
WITH_AIRSPEED = {COMMANDS: (*COMMANDS, "n_x"), RATES: (*RATES, "V_dot")}

ERRORS = ("chi", "gamma")

# No feedback: measured roll and load factor do not act on their commands.
NO_FEEDBACK = (0.0, 0.0)

# The third error is the error of the airspeed divided by its reference.
ERRORS_WITH_AIRSPEED = (*ERRORS, "V")

LABELS = {
    "phi": "phi [rad]",
    "n_z": "n_z [1]",
    "n_x": "n_x [1]",
    "chi_dot": "chi' [1/s]",
    "gamma_dot": "gamma' [1/s]",
    "V_dot": "V'/V [1/s]",
}


def channel_names(names: tuple[str, ...], count: int, usual: tuple[str, ...]) -> tuple[str, ...]:
    """`names`, or without any `usual` if there are as many channels, else a letter and numbers."""
    if names or count == len(usual):
        return names or usual
    letter = "e" if usual == ERRORS else "u"
    return tuple(f"{letter}{i + 1}" for i in range(count))


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PIGains:
    """Gains of ``u = K_P e + K_I xi`` with ``d(xi)/dt = e``, m inputs and p errors.

    Two gain sets are equal if all numbers and channel names are equal.

    Attributes
    ----------
    K_P : ndarray, shape (m, p), input unit per error unit
        Proportional gain.
    K_I : ndarray, shape (m, p), input unit per error unit and second
        Integral gain.
    inputs, errors : tuple of str, lengths m and p
        Channel names, in row and column order. By default ``phi, n_z`` and ``chi, gamma`` of two
        channels, else ``u1, u2, ...`` and ``e1, e2, ...``.
    feedback : tuple of two float, 1
        For the exact law alone: gains k on the difference between u and measured roll and load
        factor, from 0 to below 1. The commands are ``u + k (u - measured)``.

    Examples
    --------
    >>> ft.PIGains(K_P=[[1.7, 0.0], [0.0, 2.5]], K_I=[[0.6, 0.0], [0.0, 1.1]]).inputs
    ('phi', 'n_z')
    """

    K_P: FloatArray
    K_I: FloatArray
    inputs: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    feedback: tuple[float, float] = NO_FEEDBACK

    def __post_init__(self) -> None:
        m, p = read_only_matrix("K_P", self.K_P).shape
        for name, count, usual in (("inputs", m, COMMANDS), ("errors", p, ERRORS)):
            object.__setattr__(self, name, channel_names(getattr(self, name), count, usual))
        shape = len(self.inputs), len(self.errors)
        set_read_only(self, K_P=shape, K_I=shape)
        object.__setattr__(self, "feedback", tuple(map(float, self.feedback)))
        # Below 1 no delay of roll or load factor makes the inner feedback alone unstable.
        fed = list(self.feedback)
        if len(fed) != 2 or not all(0.0 <= k < 1.0 for k in fed):
            raise InputError(f"`feedback` must be two numbers from 0 to below 1, got {fed}.")
        if self.feeds_back and self.inputs[:2] != RATES:
            raise InputError(f"`feedback` must be 0 but for gains of the exact law, got {fed}.")

    @model_serializer(mode="wrap")
    def _without_defaults(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Gains without feedback are written as before the key existed."""
        fields = dict(serialize(self))
        if not self.feeds_back:
            del fields["feedback"]
        return fields

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PIGains) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[object, ...]:
        return self.inputs, self.errors, tuple(self.numbers.tolist())

    @property
    def feeds_back(self) -> bool:
        """Whether measured roll or load factor acts on the commands."""
        return any(self.feedback)

    @property
    def numbers(self) -> FloatArray:
        """All gains: `K` row by row, then `feedback`."""
        return np.append(self.K, self.feedback)

    @property
    def K(self) -> FloatArray:
        """The stacked gain (K_P, K_I), shape (m, 2 p)."""
        return np.hstack([self.K_P, self.K_I])

    @property
    def law(self) -> str:
        """The built-in law with these inputs, as files name it: ``exact`` for rates."""
        return "exact" if self.inputs[:2] == RATES else "paper"

    @property
    def airspeed(self) -> bool:
        """Whether the airspeed is the third channel."""
        return self.errors == ERRORS_WITH_AIRSPEED

    @property
    def labels(self) -> tuple[str, ...]:
        """Input of each row, with its unit."""
        return tuple(LABELS.get(name, name) for name in self.inputs)

    def as_lists(self) -> dict[str, Any]:
        """``K_P`` and ``K_I`` as nested lists, as files and ``--json`` have them.

        Gains of the exact law also have ``law``.
        """
        law = {"law": self.law} if self.law == "exact" else {}
        fed = {"feedback": list(self.feedback)} if self.feeds_back else {}
        return {"K_P": self.K_P.tolist(), "K_I": self.K_I.tolist(), **fed, **law}

    def save(self, path: str | Path) -> None:
        """Write the gains (.json), which `load_gains` and ``--gains`` of commands read."""
        write_text(Path(path), json.dumps(self.as_lists(), indent=2) + "\n")

    @classmethod
    def from_lists(
        cls,
        K_P: npt.ArrayLike,
        K_I: npt.ArrayLike,
        law: str | None = None,
        feedback: Sequence[float] | None = None,
    ) -> "PIGains":
        """The gains that `as_lists` wrote."""
        K_P, K_I = read_only_matrix("K_P", K_P), read_only_matrix("K_I", K_I)
        inputs, errors = RATES if law == "exact" else COMMANDS, ERRORS
        if len(K_P) > len(errors):
            inputs, errors = WITH_AIRSPEED[inputs], ERRORS_WITH_AIRSPEED
        # The class refuses anything but two numbers.
        fed = cast("tuple[float, float]", feedback or NO_FEEDBACK)
        return cls(K_P=K_P, K_I=K_I, inputs=inputs, errors=errors, feedback=fed)


# K* as printed below Eq. (43) of arXiv 2411.13140; rows phi, n_z; columns e_chi, e_gamma.
PAPER_GAINS = PIGains(
    K_P=np.array([[1.6968, 0.5906], [-0.5906, 1.9556]]),
    K_I=np.array([[3.4869, 0.1784], [-0.1784, 3.4869]]),
)

# Design airspeed of the paper's gains, m/s: gains for the same loop grow with airspeed.
PAPER_SPEED = 25.0

# Table 2 of arXiv 2411.13140: K = K* - epsilon (I, I).
PAPER_EPSILON = {"K1": -4.0, "K2": -2.0, "K3": -1.0, "K4": 0.5, "K5": 0.8, "K6": 1.0}


@cache
def paper_family() -> Mapping[str, PIGains]:
    """K* (as ``paper``) and K1 to K6 of the paper's Table 2, by name."""
    family = {name: shifted(PAPER_GAINS, by) for name, by in PAPER_EPSILON.items()}
    return MappingProxyType({"paper": PAPER_GAINS, **family})


def shifted(gains: PIGains, epsilon: float) -> PIGains:
    """``K - epsilon (I, I)``, as the paper derives K1 to K6 from K*."""
    shift = epsilon * np.eye(2)
    return PIGains(K_P=gains.K_P - shift, K_I=gains.K_I - shift)


def rate_gains(gains: PIGains, *, V_a: float, g: float = G_PAPER) -> PIGains:
    """Gains of the paper's law as gains of the exact law; gains of the exact law unchanged.

    Parameters
    ----------
    gains : PIGains
    V_a : float, m/s
        Design airspeed of the gains.
    g : float, m/s^2

    Returns
    -------
    PIGains
        The gains times ``g / V_a``: the same loop about wings-level flight at gamma = 0.

    Examples
    --------
    >>> ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0).K_P.diagonal().round(3).tolist()
    [0.666, 0.767]
    """
    check_positive(V_a=V_a, g=g)
    return _acting_on(RATES, gains, g / V_a)


def command_gains(gains: PIGains, *, V_a: float, g: float = G_PAPER) -> PIGains:
    """Gains of the exact law as gains of the paper's law; gains of the paper's law unchanged.

    Parameters
    ----------
    gains : PIGains
    V_a : float, m/s
        Airspeed of the result.
    g : float, m/s^2

    Returns
    -------
    PIGains
        The gains times ``V_a / g``: the inverse of `rate_gains`.

    Examples
    --------
    >>> gains = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
    >>> ft.loop.command_gains(gains, V_a=25.0).K_P.diagonal().round(3).tolist()
    [1.697, 1.956]
    """
    check_positive(V_a=V_a, g=g)
    return _acting_on(COMMANDS, gains, V_a / g)


def _acting_on(inputs: tuple[str, str], gains: PIGains, factor: float) -> PIGains:
    if gains.inputs[:2] == inputs:
        return gains
    if gains.feeds_back:
        raise InputError(
            "`gains` must be flown by the exact law where they feed roll or load factor back, got "
            f"`feedback` {list(gains.feedback)}."
        )
    K_P, K_I, n = gains.K_P * factor, gains.K_I * factor, len(gains.errors)
    if gains.airspeed:
        # The exact law adds sin(gamma) as measured, the paper's law sin(gamma_ref). Their
        # difference is cos(gamma) times the error of the path angle, a gain of one in level flight.
        K_P[2, 1] += factor if inputs == RATES else -1.0
    return PIGains(K_P=K_P, K_I=K_I, inputs=WITH_AIRSPEED[inputs][:n], errors=gains.errors)


def gains_lists(gains: PIGains | None) -> dict[str, Any]:
    """``K_P`` and ``K_I`` as nested lists, None without gains."""
    return {"K_P": None, "K_I": None} if gains is None else gains.as_lists()
