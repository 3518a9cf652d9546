"""Crystals with sites that are off: checks of their potential, and their forces and stresses.

`engines.lammps.site_off` makes the potentials. `check` compares energies and forces with those of
the whole crystal, and `measure` measures what scheme FS needs at its planes.
"""
