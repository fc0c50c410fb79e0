"""Runs to Parquet and Rerun, and back.

``parquet`` is the record, ``record`` writes it with the Rerun recording drawn from it, and
``viewer`` opens that.
"""
