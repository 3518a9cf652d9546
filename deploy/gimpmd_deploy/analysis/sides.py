"""Which atoms and points stand for the body, where both sides overlap."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan


def counted(plan: Plan, role: Role, reference: Floats) -> Bools:
    """Whether particles lie on their own side of the energy plane, shape ``(n,)``.

    In a coupled run, atoms deeper than the plane count, and material points outside it. Boundary
    atoms and inner points, which follow the other side, do not. In a run of one side all count.

    Parameters
    ----------
    reference : ndarray, shape ``(n, d)``
        Reference positions.
    """
    if plan.coupling is None:
        return np.ones(len(reference), dtype=bool)
    zones = plan.coupling.zones
    deep = zones.depth(reference) >= zones.energy_plane
    return np.asarray(deep if role == "md" else ~deep)
