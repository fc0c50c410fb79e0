"""Logs of real flights as runs, and models identified from them."""
