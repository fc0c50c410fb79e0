"""Claims about flights: bounds that are proven or counted, and of which flights."""
