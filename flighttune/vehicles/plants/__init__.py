"""Aircraft in flight: the kinematic law and the full dynamics, behind one interface."""
