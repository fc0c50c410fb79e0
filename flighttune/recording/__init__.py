"""Runs to Parquet and Rerun, and back.

``parquet`` is the record and ``rrd`` a view of it; ``view`` opens it, ``live`` shows flights while
they are flown.
"""
