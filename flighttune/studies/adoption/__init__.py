"""Aircraft for every command, made from JSBSim models: survey, design, identification."""
