"""Coupling steps of the atoms' side, without a continuum."""

from __future__ import annotations

import numpy as np

from gimpmd_md.side import MdSide
from gimpmd_schemas.wire.energies import Energies


def advance(side: MdSide, velocity: np.ndarray | None = None) -> None:
    """One coupling step, to the end: with nodal velocities, or with all nodes at rest."""
    side.receive({} if velocity is None else {"velocity": velocity})
    side.advance()
    side.finish()


def advance_by(side: MdSide, steps: int) -> None:
    """Coupling steps without nodal velocities."""
    for _ in range(steps):
        advance(side)


def energies(side: MdSide) -> Energies:
    """Energies of the last step, which must have some."""
    found = side.energies()
    assert found is not None
    return found


def total(side: MdSide) -> float:
    """Kinetic and potential energy."""
    found = energies(side)
    return found.kinetic + found.potential


def having(side: MdSide, bits: int) -> np.ndarray:
    """Which atoms have one of the role bits."""
    return (side.atoms.role & bits) != 0
