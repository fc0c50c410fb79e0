"""References of the outer loop: changes over time, feasible ones, routes; plans, maps, fences."""
