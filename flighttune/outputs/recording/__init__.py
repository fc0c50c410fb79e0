"""Writes runs to Parquet and Rerun, and reads them.

``parquet`` keeps the data, ``record`` writes it together with a Rerun recording drawn from it, and
``viewer`` opens the recording.
"""
