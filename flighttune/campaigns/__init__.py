"""Many flights of one scenario, dispersed: planned, flown, stored and evaluated."""
