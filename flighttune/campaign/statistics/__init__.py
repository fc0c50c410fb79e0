"""What the rows of a campaign say, with intervals."""
