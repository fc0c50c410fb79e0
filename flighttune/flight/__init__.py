"""A scenario to runs: tune, fly, hold against requirements, explain, fly again."""
