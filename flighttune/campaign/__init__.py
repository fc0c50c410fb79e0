"""Many flights of one scenario, dispersed: planned, flown, kept, and what they tell."""
