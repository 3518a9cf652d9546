"""Potentials whose sites can be switched off, made from the user's own potential.

Scheme FS sums the energies of *active* sites only: free atoms and the ghosts between the two
planes. Ghosts farther out are neighbours of active sites, but have no energy of their own. For each
type of atom the potential made here has a second type whose sites are off. The energy that LAMMPS
gives is then ``sum_i V_i`` over the sites that are on, V_i the site energy. The energy of a pair
belongs half to each of its two sites.

`commands` reads the pair commands from LAMMPS's log, `double` makes the potential, and `setfl`,
`threebody` and `snap` know the files of the styles.
"""
