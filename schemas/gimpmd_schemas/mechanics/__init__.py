"""Continuum mechanics for both sides: elasticity, strain energies, initial state, units."""
