"""Aircraft: their files, the plants that fly them, and the models identified in flight."""
