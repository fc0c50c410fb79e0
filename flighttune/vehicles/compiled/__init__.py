# SPDX-License-Identifier: LGPL-2.1-or-later
"""JSBSim's step as compiled code, to the bit. The rest of the package imports `face` alone."""
