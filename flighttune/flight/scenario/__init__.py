"""TOML to a validated scenario: keys and what holds between them."""
