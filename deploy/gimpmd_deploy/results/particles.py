"""Atoms or material points at one time, as arrays of the same form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gimpmd_deploy.results.frames import dataframe
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.mechanics.elasticity import VOIGT


def voigt_names(dim: int) -> list[str]:
    """Return the names of stress components in Voigt order, ``xx``, ``yy`` and so on."""
    return ["xyz"[i] + "xyz"[j] for i, j in VOIGT[dim]]


@dataclass(frozen=True)
class Particles:
    """Atoms or material points at one time: ``n`` rows in each array, in the order of their ids.

    All arrays have components for the ``d`` axes of the body, 2 or 3.

    Attributes
    ----------
    time : float
    reference : ndarray, shape ``(n, d)``
        Position in the reference state: of an atom its lattice site. The same in every run of a
        case, so it identifies a particle.
    position, displacement, velocity : ndarray, shape ``(n, d)``
        Displacements are measured from the reference state (of atoms: after relaxation).
    stress : ndarray, shape ``(n, 3)`` or ``(n, 6)``
        Cauchy stress (pressure units) in Voigt order: xx, yy, xy, or xx, yy, zz, yz, xz, xy.
    size : ndarray, shape ``(n, d)``
        Edges of a material point; of an atom the distance to its neighbours.
    fields : mapping of str to ndarray with ``n`` rows
        All other columns that the run wrote, by name.
    """

    time: float
    reference: Floats
    position: Floats
    displacement: Floats
    velocity: Floats
    stress: Floats
    size: Floats
    fields: Mapping[str, Any]

    def __len__(self) -> int:
        """Return the number of particles."""
        return self.position.shape[0]

    @property
    def dim(self) -> int:
        """Number of dimensions, 2 or 3."""
        return self.position.shape[1]

    def where(self, mask: Bools) -> Particles:
        """Return the particles for which ``mask``, shape ``(n,)``, is true."""
        return Particles(
            self.time,
            self.reference[mask],
            self.position[mask],
            self.displacement[mask],
            self.velocity[mask],
            self.stress[mask],
            self.size[mask],
            {name: values[mask] for name, values in self.fields.items()},
        )

    def to_dataframe(self) -> Any:
        """Return all arrays as a pandas DataFrame, one row for each particle.

        Columns are named ``position_x``, ``stress_xy`` and so on.

        Raises
        ------
        BackendError
            pandas is not installed.
        """
        axes = "xyz"[: self.dim]
        columns: dict[str, Any] = {}
        for name in ("reference", "position", "displacement", "velocity", "size"):
            values = getattr(self, name)
            columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate(axes)}
        columns |= {f"stress_{ij}": self.stress[:, k] for k, ij in enumerate(voigt_names(self.dim))}
        for name, values in self.fields.items():
            parts = values[:, None] if values.ndim == 1 else values
            single = parts.shape[1] == 1
            columns |= {
                name if single else f"{name}_{k}": part
                for k, part in enumerate(np.transpose(parts))
            }
        return dataframe(columns)
