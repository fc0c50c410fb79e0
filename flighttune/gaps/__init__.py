"""The gap from the paper's law to an aircraft: the ladder, the mismatch, the residual."""
