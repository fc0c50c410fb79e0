"""A scenario to runs: tune, fly, hold against expectations, explain, fly again."""
