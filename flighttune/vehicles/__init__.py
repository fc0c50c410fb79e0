"""Aircraft: their files, their plants, and models identified in flight."""
