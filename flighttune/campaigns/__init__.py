"""Dispersed flights of one scenario: planned, flown, stored and evaluated."""
