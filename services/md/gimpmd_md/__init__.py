"""The MD service: LAMMPS drives the atoms, and atoms and grid nodes exchange velocities."""
