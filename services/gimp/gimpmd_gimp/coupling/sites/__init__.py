"""An interface for any potential that is a sum over sites (scheme FS), as geometry and algebra.

The energy is ``sum_i V_i`` over *active* sites, plus the strain energy of the continuum beyond
plane 2, plus a small correction near the planes. Atoms inside plane 1 are free. Atoms between
plane 1 and plane 2 are inner ghosts: their sites are active, but they move with the nodes. Outer
ghosts lie up to a cutoff beyond plane 2; they move with the nodes too, and have no energy.
Material points fill all beyond plane 1 and have the mass; between the planes they have no strain
energy, because there the crystal of the inner ghosts is the stiffness.

`shells` knows the boxes within the planes, `pieces` cuts the cells at them, `slaves` ties nodes
with next to no continuum to others, `residual` is the nodal force that uniform strain leaves, and
`correction` removes it, with the least solution that `least_norm` finds; near faces of the body
`spared` says what cannot be removed. `layout` finds all this
for a plan, and `terms` are the forces and the energy of the corrections in a run.
"""
