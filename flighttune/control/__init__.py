"""The loop on paper: linear models, gains, limits and the discrete controller."""
