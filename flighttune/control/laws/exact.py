"""The exact law: gains command rates, which are inverted for roll and load factor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.words import pick
from flighttune.control.controller import LawSetup
from flighttune.control.exact_law import BRAKING, LIFT_FLOOR, ExactLaw, Priority
from flighttune.control.gains import RATES
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import Law, OuterLoop, SampledController, pi_settings
from flighttune.control.linear_model import LinearModel

# An error counts as much as its rate over this number of channel lags: design/exact_gains.md.
LAGS_PER_ERROR = 3.0

# Replaces infinity in a property of JSBSim.
NO_BRAKE = 1e300


@dataclass(frozen=True, kw_only=True)
class Exact(Law):
    """See `ExactLaw`, where the options are explained."""

    priority: Priority = "gamma"
    lift_floor: float = LIFT_FLOOR
    braking: float | None = BRAKING
    brakes_turns: bool | None = None

    kind: ClassVar[str] = "exact"
    by_gains: ClassVar[bool] = True
    keys: ClassVar[frozenset[str]] = frozenset(
        {"priority", "lift_floor", "braking", "brakes_turns"}
    )
    inputs: ClassVar[tuple[str, str]] = RATES
    trapezoidal: ClassVar[bool] = False
    same_everywhere: ClassVar[bool] = True
    batched: ClassVar[bool] = True
    plant: ClassVar[str] = "point_mass"

    def make(self, setup: LawSetup, /) -> ExactLaw:
        """Make the controller of a flight."""
        options = pick(self, "priority lift_floor braking brakes_turns")
        return ExactLaw(**pi_settings(setup, "the exact law"), **options)

    def state_scaling(self, model: LinearModel, lags: Sequence[InnerLag]) -> FloatArray:
        """Units of the states; the unit of an error is `LAGS_PER_ERROR` lags of its channel."""
        scaling = super().state_scaling(model, lags)
        # Gains are then proportional to one over the lag on any aircraft.
        scaling[-len(lags) :] = [LAGS_PER_ERROR * lag.whole for lag in lags]
        return scaling

    def sampled(self, setup: LawSetup, /) -> SampledController:
        """The controller as a tube encloses it: channels of rates, and their inversion."""
        law = self.make(setup).law
        return SampledController(law.channels, law.conditional, inverts=law)

    def outer_loop(self, setup: LawSetup, /) -> OuterLoop:
        """The controller for JSBSim alone."""
        law = self.make(setup).law
        values = {
            "ft/outer/conditional": float(law.conditional),
            "ft/outer/tracking-gain": law.tracking_gain,
            "ft/outer/per-speed-s_m": law.per_g,
            "ft/outer/by-turning-speed": 1.0,
            "ft/outer/brake": float(min(law.brake, NO_BRAKE)),
            "ft/outer/turn-brake": float(min(law.turn_brake, NO_BRAKE)),
            "ft/outer/feedback/phi": law.feedback[0],
            "ft/outer/feedback/n_z": law.feedback[1],
            "ft/outer/lift-floor": law.lift_floor,
            "ft/outer/course-first": float(law.course_first),
        }
        return OuterLoop("exact_law.xml", ("chi", "gamma", "V"), values, takes_rates=True)

    def in_c(self, setup: LawSetup, /) -> ExactLaw:
        """The controller itself, of two commands."""
        controller = self.make(setup)
        if controller.gains.airspeed:
            raise InputError(
                "`V_mps` of [reference] must be absent for the exact law in C, which has no n_x."
            )
        return controller
