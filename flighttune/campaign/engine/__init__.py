"""Plans flown by the workers of a cluster."""
