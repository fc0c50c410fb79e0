"""Claims about flights: proven or counted bounds, and the flights that they cover."""
