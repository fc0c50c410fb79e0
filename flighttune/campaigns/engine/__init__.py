"""Plans flown by workers, on this machine or on a cluster."""
