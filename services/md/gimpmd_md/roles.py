"""Roles of atoms: what an atom does in a coupled run, as bits of one integer.

An atom has its role from its lattice position, before the run starts, and keeps it.
"""

from __future__ import annotations

BOUNDARY, CORE, PROJECTED, WATCHED, PRELOADED, OFF = 1, 2, 4, 8, 16, 32
"""The bits that do not depend on the parts of the faces.

``BOUNDARY``: the atom moves with the nodes of the continuum. ``CORE``: its mass, momentum and
kinetic energy count on the atoms' side of the interface. ``PROJECTED``: its motion is seen by the
nodes, by the absorber, or by the monitor of short waves. ``WATCHED``: its bonds are watched,
because defects must not come there.
``PRELOADED``: a constant force acts in place of the atoms that are missing outside the face.
``OFF``: the energy of the atom's site does not count; its neighbours see it as any other atom.
"""

_PARTS = 64
"""Bit of the first part of the faces."""


def part_bit(number: int) -> int:
    """Bit of the atoms on which the condition of a part of a face acts.

    ``number`` is the place of the part in ``Plan.face_parts``: at most 24, as roles are 32-bit
    integers whose sign must stay.
    """
    return _PARTS << number
