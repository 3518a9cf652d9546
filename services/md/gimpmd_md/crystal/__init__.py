"""What LAMMPS knows of the user's crystal: lattice, planes, bonds, moduli, strain energy."""
