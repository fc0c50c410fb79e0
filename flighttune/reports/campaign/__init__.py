"""The page on a campaign."""
