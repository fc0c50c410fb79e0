"""Aircraft that every command takes, made from JSBSim models: survey, design, identification."""
