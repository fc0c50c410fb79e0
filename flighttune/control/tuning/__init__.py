"""From a tuning problem to gains."""
