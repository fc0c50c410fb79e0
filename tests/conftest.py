"""Property tests judge results, not the clock, and repeat themselves where they gate a change."""

import os

from hypothesis import settings

settings.register_profile("here", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("here")
