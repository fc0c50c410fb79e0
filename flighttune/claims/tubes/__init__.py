"""The set of all errors that the flights of a scenario can have, proven: docs/tube.md."""
