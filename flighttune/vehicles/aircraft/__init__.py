"""An aircraft folder: its tables, off-nominal airframes, and the XML for JSBSim."""
