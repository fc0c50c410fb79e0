"""Routes: waypoints to a path that an aircraft can fly, and a reference that follows it."""
