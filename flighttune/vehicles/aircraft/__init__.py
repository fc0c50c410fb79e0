"""An aircraft folder: its tables, its airframe off the nominal, and the XML that JSBSim loads."""
