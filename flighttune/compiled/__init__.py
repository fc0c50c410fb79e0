# SPDX-License-Identifier: LGPL-2.1-or-later
"""JSBSim's step as compiled code, to the bit: `load` gives an aircraft that flies many flights.

Inside, `face` makes the step and `check` compares it with JSBSim. Of an aircraft it takes a
`model.Source`, of JSBSim what `dynamics.FlightDynamics` has.
"""

from flighttune.compiled.simulator import Aircraft, State, load

__all__ = ["Aircraft", "State", "load"]
