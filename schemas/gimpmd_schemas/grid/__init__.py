"""The background grid that both sides share, interpolation on it, and where the sides meet."""
