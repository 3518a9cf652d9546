"""One step of GIMP, and the solver."""
