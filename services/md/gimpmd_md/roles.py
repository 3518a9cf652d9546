"""Roles of atoms: what an atom does in a coupled run, as bits of one integer.

An atom has its role from its lattice position, before the run starts, and keeps it.
"""

from __future__ import annotations

BOUNDARY, CORE, PROJECTED, WATCHED = 1, 2, 4, 8
"""The bits of the coupling scheme.

``BOUNDARY``: the atom moves with the nodes of the continuum. ``CORE``: its mass, momentum and
kinetic energy count on the atoms' side of the interface. ``PROJECTED``: its motion is seen by the
nodes, or by the absorber. ``WATCHED``: its bonds are watched, because defects must not come there.
"""

_FACES = 16
"""First bit of the faces. Each face of the domain has two bits; a box has at most six faces."""


def traction_bit(axis: int, side: int) -> int:
    """Bit of the atoms that carry the traction on the lower (0) or upper (1) face of an axis."""
    return _FACES << (2 * axis + side)


def velocity_bit(axis: int, side: int) -> int:
    """Bit of the atoms that follow the velocity prescribed on a face; see `traction_bit`."""
    return _FACES << (6 + 2 * axis + side)
