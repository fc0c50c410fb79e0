"""Gains chosen by what they fly to."""
