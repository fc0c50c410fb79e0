"""``python -m flighttune``."""

from flighttune.cli import main

main()
