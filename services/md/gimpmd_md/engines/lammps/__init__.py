"""LAMMPS as the engine of the atoms."""
