"""Continuum mechanics that both sides need: elasticity, strain energies, initial state, units."""
