"""The paper's law: roll and load factor by a discrete PI of the errors."""

from dataclasses import dataclass, replace
from typing import ClassVar

from flighttune.base.words import pick
from flighttune.control.controller import LawSetup
from flighttune.control.law import Law, OuterLoop, SampledController, Trim, pi_settings
from flighttune.control.linear_model import LinearModel
from flighttune.control.mimo_pi import MimoPI


@dataclass(frozen=True, kw_only=True)
class Paper(Law):
    """See `MimoPI`."""

    kind: ClassVar[str] = "paper"
    by_gains: ClassVar[bool] = True
    batched: ClassVar[bool] = True

    def make(self, setup: LawSetup, /) -> MimoPI:
        """Make the controller of a flight."""
        options = pick(setup, "schedule_speed feed_forward")
        return MimoPI(**pi_settings(setup, "the paper's law"), **options)

    def linear_model(self, trim: Trim, /) -> LinearModel:
        """Error dynamics; a schedule gives the same loop with a scaled input matrix."""
        model = super().linear_model(trim)
        if trim.schedule_speed is None:
            return model
        return replace(model, B=model.B * (trim.V_a / trim.schedule_speed))

    def sampled(self, setup: LawSetup, /) -> SampledController:
        """The controller as a tube encloses it."""
        pi = self.make(setup)
        return SampledController(pi.law.channels, pi.law.conditional, pi.feed_forward)

    def outer_loop(self, setup: LawSetup, /) -> OuterLoop:
        """The controller for JSBSim alone."""
        controller = self.make(setup)
        values = {
            "ft/outer/conditional": float(controller.law.conditional),
            "ft/outer/tracking-gain": controller.law.tracking_gain,
            "ft/outer/per-speed-s_m": controller.law.per_speed,
            "ft/outer/feed-forward": float(controller.feed_forward),
            "ft/outer/planned": 0.0,  # 1 if the reference has planned commands
        }
        return OuterLoop(None, ("phi", "n_z", "n_x"), values, takes_plan=controller.feed_forward)

    def in_c(self, setup: LawSetup, /) -> MimoPI:
        """The controller itself."""
        return self.make(setup)
