"""Runs to Rerun and Parquet, and back."""
