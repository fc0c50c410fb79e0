"""The closed loop in time."""
