"""The background grid that both sides share, its interpolation, and where the sides meet."""
