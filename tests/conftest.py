"""Property tests judge results, not the clock, and try the same cases every time."""

import os
import sys

from hypothesis import settings

# As in commands: with two workers on two cores, threads of BLAS spend their time on each other.
assert "numpy" not in sys.modules, "NumPy reads the number of threads when it is imported"
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

settings.register_profile("here", deadline=None, derandomize=True, database=None)
settings.load_profile("here")
