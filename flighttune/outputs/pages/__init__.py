"""Figures and pages for colleagues."""
