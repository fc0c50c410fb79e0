"""Runs to Parquet and Rerun, and back: the only importer of rerun.

``parquet`` is the record and ``rrd`` a view of it; ``page`` writes the text of that view, ``view``
and ``screenshot`` open it.
"""
