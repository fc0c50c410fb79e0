"""Models measured in flight, and the design of the inner loop on them."""
