"""Campaigns on disk."""
