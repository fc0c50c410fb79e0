"""The 6-DoF plant: the only importer of jsbsim, the only place with feet."""
