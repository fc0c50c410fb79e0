"""A flown inner loop to a lag model: excite, fit, check on another manoeuvre, write to a file."""
