"""Nested levels of the background grid: nodes, constraints, nodal fields."""
