"""Statistics of a campaign's rows, with intervals."""
