"""The MD service: LAMMPS drives the atoms, and atoms and grid nodes exchange velocities."""

from gimpmd_coupler.exit import kill_rank_on_error

kill_rank_on_error()  # before anything is imported that may fail
