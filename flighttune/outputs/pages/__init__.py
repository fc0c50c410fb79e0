"""Figures and pages to send to a colleague."""
