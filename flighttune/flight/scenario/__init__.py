"""TOML to a validated scenario: keys and the rules between them."""
