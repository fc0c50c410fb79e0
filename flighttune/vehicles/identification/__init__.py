"""Models measured in flight, and the inner loop that is designed on them."""
