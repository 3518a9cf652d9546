"""Atomic strain of any LAMMPS run, live or from a dump (paper sections 3.1 to 3.3)."""
