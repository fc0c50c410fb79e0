"""From a scenario to runs: tune, fly, check requirements, explain, repeat."""
