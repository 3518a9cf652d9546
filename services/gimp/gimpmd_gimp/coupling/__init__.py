"""Coupling schemes on the side of the continuum."""
