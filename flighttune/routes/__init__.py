"""References of the outer loop: changes over time, feasible changes, routes, maps and fences."""
