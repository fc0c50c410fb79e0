"""Property tests judge results, not the clock, and try the same cases every time."""

from hypothesis import settings

settings.register_profile("here", deadline=None, derandomize=True, database=None)
settings.load_profile("here")
