"""Logs of real flights as runs, and what is identified from them."""
