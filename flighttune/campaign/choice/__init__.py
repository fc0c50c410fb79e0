"""Gains chosen by flying them."""
