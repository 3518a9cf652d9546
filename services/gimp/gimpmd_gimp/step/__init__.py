"""One time step of GIMP."""
