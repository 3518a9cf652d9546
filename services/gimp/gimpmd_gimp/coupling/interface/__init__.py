"""The continuum's side of the force scheme's interface, as geometry and algebra.

`cutting` lets material points end at the planes, `lattice` knows the crystal, `bonds` finds the
bonds that cross the planes, `weights` says which nodes move what, `correction` makes uniform
strain exact, and `terms` sums energy and forces as functions of nodal displacements.
"""
