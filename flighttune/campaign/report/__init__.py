"""What the flights of a campaign tell, and the page that says it."""
