# SPDX-License-Identifier: LGPL-2.1-or-later
"""JSBSim's step as compiled code, to the bit: `face` makes it, `check` compares it with JSBSim.

Of an aircraft it takes a `model.Source`, of JSBSim what `dynamics.FlightDynamics` has.
"""
