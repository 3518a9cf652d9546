"""Cracks: a second velocity field, contact of faces, J-integrals."""
