"""The continuum service: the generalized interpolation material point method (GIMP)."""
