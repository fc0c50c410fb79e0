"""A model of JSBSim's to an aircraft that every command takes: surveyed, designed, identified."""
