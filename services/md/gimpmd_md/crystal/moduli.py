"""Density and elastic moduli of the user's crystal, measured by LAMMPS on a periodic cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimpmd_md.crystal.bonds import Bonds, strains
from gimpmd_md.crystal.bravais import area, primitive
from gimpmd_md.crystal.cell import Cell
from gimpmd_md.crystal.equilibrium import FACTORS, at_rest, near_rest, stiffness
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.materials import Anisotropic, Elastic
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

STRAIN = 1e-4
"""Strain of the central differences; their error is its square times the third-order moduli."""

MAX_REST_STRAIN = 1e-3
"""Largest accepted stress of the undeformed cell, over the modulus."""

SAME = 1e-6
"""Difference up to which the factors of the edges of a cell count as equal."""

NEGLIGIBLE = 1e-6
"""Elastic constants smaller than this, over the largest one, are zero by symmetry."""

MAX_ANISOTROPY = 1e-2
"""Largest accepted ``|C11 - C12 - 2 C66| / C11`` and ``|C11 - C22| / C11``."""


def measure(cell: Cell) -> Elastic:
    """Measure a crystal by small static strains.

    Returns
    -------
    Elastic
        Density (mass / length^2), ``lame = C12`` and ``shear = C66`` (pressure units).

    Raises
    ------
    BackendError
        The cell is under stress, unstable, or not isotropic in the plane.
    """
    rest = _stress(cell, np.zeros((2, 2)))
    # columns: stress per unit of strain xx, yy and (engineering) xy
    C = np.empty((3, 3))
    for column, (i, j) in enumerate(((0, 0), (1, 1), (0, 1))):
        strain = np.zeros((2, 2))
        strain[i, j] = STRAIN
        C[:, column] = (_stress(cell, strain) - _stress(cell, -strain)) / (2.0 * STRAIN)
    return _isotropic(cell, rest, C)


def measure_all(cell: Cell) -> Anisotropic:
    """Measure all elastic constants of a crystal by small static strains.

    Returns
    -------
    Anisotropic
        Density (mass / length^d) and stiffness (pressure units, Voigt order).

    Raises
    ------
    BackendError
        The cell is under stress or unstable.
    """
    _, rest = cell.deform(np.eye(len(cell.box)))
    C = stiffness(cell, np.eye(len(cell.box)))
    values = np.linalg.eigvalsh(C)
    if not values[0] > 0.0:
        raise BackendError(
            f"{cell.script}: the crystal is unstable: the smallest eigenvalue of its stiffness is "
            f"{values[0]:g}"
        )
    if np.abs(rest).max() > MAX_REST_STRAIN * C[0, 0]:
        raise BackendError(
            f"{cell.script}: the cell is under a stress of up to {np.abs(rest).max():.4g}; "
            f"{_way_to_rest(cell)}"
        )
    C[np.abs(C) < NEGLIGIBLE * C.max()] = 0.0
    return Anisotropic(density=cell.density, stiffness=tuple(tuple(row) for row in C.tolist()))


def of_bonds(cell: Cell, vectors: Floats, found: Bonds) -> Elastic:
    """Density and moduli of a lattice with a pair potential, exactly, by sums over its bonds.

    ``C = (1 / A) sum_b phi_b''(1) g_b g_b^T`` with the area A per atom, the energy phi of a bond as
    a function of s, its squared stretch, and the change g of s - 1 with strain.

    Parameters
    ----------
    vectors : ndarray, shape ``(2, 2)``
        Primitive vectors of the crystal in the cell.
    found : Bonds
        Its bonds.

    Raises
    ------
    BackendError
        As in `measure`.
    """
    g = strains(found.vectors)
    first, second = (np.array([c[k] for c in found.energy]) for k in range(2))
    units = UNITS[str(cell.engine.lammps.extract_global("units"))]
    per_area = units.nktv2p / area(vectors)
    C = per_area * (2.0 * second * g.T) @ g
    return _isotropic(cell, per_area * first @ g, C)


def _stress(cell: Cell, strain: Floats) -> Floats:
    """Stress (xx, yy, xy) of the strained cell (pressure units)."""
    _, tau = cell.deform(np.eye(2) + strain)
    return np.array([tau[0, 0], tau[1, 1], tau[0, 1]])


def _isotropic(cell: Cell, rest: Floats, C: Floats) -> Elastic:
    script, c11, c22 = cell.script, C[0, 0], C[1, 1]
    c12, c66 = 0.5 * (C[0, 1] + C[1, 0]), C[2, 2]
    if np.abs(rest).max() > MAX_REST_STRAIN * abs(c11):
        raise BackendError(
            f"{script}: the cell is under stress (xx, yy, xy) = ({rest[0]:.4g}, {rest[1]:.4g}, "
            f"{rest[2]:.4g}); {_way_to_rest(cell)}"
        )
    if not (c11 > 0.0 and c66 > 0.0):
        raise BackendError(f"{script}: the crystal is unstable: C11 = {c11:g}, C66 = {c66:g}")
    anisotropy = max(abs(c11 - c12 - 2.0 * c66), abs(c11 - c22)) / c11
    if anisotropy > MAX_ANISOTROPY:
        raise BackendError(
            f"{script}: the crystal is not isotropic in the plane: C11 = {c11:.6g}, "
            f"C22 = {c22:.6g}, C12 = {c12:.6g}, C66 = {c66:.6g}; "
            "give the material with from: moduli or from: stiffness"
        )
    return Elastic(density=cell.density, lame=float(c12), shear=float(c66))


def _way_to_rest(cell: Cell) -> str:
    """Say which lattice constant LAMMPS finds at zero pressure and temperature."""
    try:
        F, _ = at_rest(cell, near_rest(cell, FACTORS) * np.eye(len(cell.box)))
    except BackendError as error:
        return f"use the lattice constant at zero pressure ({error})"
    edges = F @ cell.box
    before, after = (np.linalg.norm(box, axis=0) for box in (cell.box, edges))
    factors = after / before
    new, old = (" x ".join(f"{edge:.9g}" for edge in box) for box in (after, before))
    text = (
        f"at zero pressure and temperature LAMMPS finds a cell of {new} in place of {old}: "
        "multiply "
    )
    if np.ptp(factors) < SAME:
        text += f"the lattice constant by {factors[0]:.9g}"
    else:
        text += "lengths " + " and ".join(
            f"along {axis} by {factor:.9g}" for axis, factor in zip("xyz", factors, strict=False)
        )
    if len(F) == 3:
        return text
    cell.deform(F)
    vectors = primitive(replace(cell, box=edges).around())
    if vectors is not None:
        spacing = float(np.hypot(*vectors[0]))
        angle = float(np.degrees(np.arctan2(*vectors[0][::-1])))
        text += (
            f"; neighbouring atoms are then {spacing:.9g} apart, their rows at "
            f"{abs(round(angle, 4)):g} degrees to the x axis"
        )
    return text
