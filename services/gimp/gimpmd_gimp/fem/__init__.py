"""Finite elements as a second continuum code, with the elements of scikit-fem."""
