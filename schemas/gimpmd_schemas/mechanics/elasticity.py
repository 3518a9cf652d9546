"""Linear elasticity: stiffness in Voigt notation, and moduli of waves.

The components are xx, yy, xy in two dimensions and xx, yy, zz, yz, xz, xy in three. Shear strains
are engineering shear strains.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints

VOIGT = {
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
}
"""Pairs of axes in Voigt order, by the number of dimensions."""

WaveKind = Literal["P", "S", "bar"]

UNCOUPLED = 1e-9
"""Largest coupling of motions in a plane and normal to it, over the largest stiffness."""


def unit_strains(dim: int) -> Floats:
    """Symmetric displacement gradients of unit strains in Voigt order, shape ``(c, d, d)``."""
    H = np.zeros((len(VOIGT[dim]), dim, dim))
    for m, (i, j) in enumerate(VOIGT[dim]):
        H[m, i, j] += 0.5
        H[m, j, i] += 0.5
    return H


def voigt_place(dim: int) -> Ints:
    """Place in Voigt order of each component of a tensor, shape ``(d, d)``."""
    place = np.empty((dim, dim), dtype=np.int64)
    for v, (i, j) in enumerate(VOIGT[dim]):
        place[i, j] = place[j, i] = v
    return place


def plane_stress(lame: float, shear: float) -> float:
    """Convert Lame's lambda so that the formulas of plane strain give plane stress."""
    return 2.0 * lame * shear / (lame + 2.0 * shear)


def isotropic(lame: float, shear: float, dim: int) -> Floats:
    """Stiffness of an isotropic material (plane strain in 2-D), shape ``(n, n)``, n = 3 or 6."""
    n = len(VOIGT[dim])
    stiffness = np.zeros((n, n))
    stiffness[:dim, :dim] = lame
    stiffness += np.diag([2.0 * shear] * dim + [shear] * (n - dim))
    return stiffness


def isotropic_modulus(lame: float, shear: float, dim: int, kind: WaveKind) -> float:
    """Modulus M of a wave, whose speed is ``sqrt(M / density)``; for ``bar`` Young's modulus."""
    young = (
        4.0 * shear * (lame + shear) / (lame + 2.0 * shear)
        if dim == 2
        else shear * (3.0 * lame + 2.0 * shear) / (lame + shear)
    )
    return {"P": lame + 2.0 * shear, "S": shear, "bar": young}[kind]


def anisotropic_modulus(stiffness: Floats, kind: WaveKind) -> float:
    """Modulus of the fastest (P) or the slowest (S) wave along the axes, for any stiffness.

    A wave in another direction can be slightly faster. For ``bar`` the modulus is ``1 / S11``,
    Young's modulus along x.
    """
    if kind == "bar":
        return float(1.0 / np.linalg.inv(stiffness)[0, 0])
    dim = 2 if stiffness.shape[0] == 3 else 3
    modes = [np.linalg.eigvalsh(christoffel(stiffness, axis)) for axis in range(dim)]
    return float(np.max(modes) if kind == "P" else np.min(modes))


def plane_wave_moduli(stiffness: Floats, direction: Floats) -> Floats:
    """Moduli of the plane waves that travel along a direction, largest first, shape ``(d,)``.

    They are the eigenvalues of the Christoffel tensor ``C_ijkl n_j n_l``; the speed of a wave is
    ``sqrt(modulus / density)``.

    Parameters
    ----------
    stiffness : ndarray, shape ``(3, 3)`` or ``(6, 6)``
    direction : ndarray, shape ``(d,)``
        Of any length.
    """
    n = np.asarray(direction, float) / np.linalg.norm(direction)
    return np.asarray(np.linalg.eigvalsh(christoffel_of(stiffness, n[None])[0])[::-1])


def christoffel_of(stiffness: Floats, k: Floats) -> Floats:
    """Christoffel tensors ``C_ijml k_j k_l`` of wave vectors ``k (n, d)``, shape ``(n, d, d)``."""
    axes = range(k.shape[1])
    return np.asarray(
        sum(
            (k[:, j] * k[:, m])[:, None, None] * _block(stiffness, j, m) for j in axes for m in axes
        )
    )


def christoffel(stiffness: Floats, axis: int) -> Floats:
    """Christoffel tensor ``C_{i axis, k axis}`` of plane waves along an axis, shape ``(d, d)``."""
    return _block(stiffness, axis, axis)


def keeps_in_plane(stiffness: Floats, first: int, second: int) -> bool:
    """Whether waves in the plane of two axes move either in this plane or normal to it.

    They do so in a mirror plane.

    Parameters
    ----------
    stiffness : ndarray, shape ``(6, 6)``
    first, second : int
        The axes.
    """
    normal = ({0, 1, 2} - {first, second}).pop()
    k = np.eye(3)[[first, second, first]]  # Christoffel tensors are quadratic in k: three will do
    k[2, second] = 1.0
    tensors = christoffel_of(stiffness, k)
    coupling = tensors[:, [first, second], normal]
    return bool(np.abs(coupling).max() <= UNCOUPLED * np.abs(stiffness).max())


def traction(stiffness: Floats, axis: int, gradient: Floats) -> Floats:
    """Traction ``C_{i axis, k m} du_k / dx_m`` on planes whose normal is an axis.

    Parameters
    ----------
    stiffness : ndarray, shape ``(3, 3)`` or ``(6, 6)``
    axis : int
    gradient : ndarray, shape ``(n, d, d)``
        ``gradient[:, k, m] = du_k / dx_m``.

    Returns
    -------
    ndarray, shape ``(n, d)``
    """
    blocks = [_block(stiffness, axis, m) for m in range(gradient.shape[2])]
    return np.einsum("mik,nkm->ni", np.stack(blocks), gradient)


def _block(stiffness: Floats, j: int, m: int) -> Floats:
    """``C_ijkm`` for all i and k, shape ``(d, d)``."""
    dim = 2 if stiffness.shape[0] == 3 else 3
    place = voigt_place(dim)
    return stiffness[np.ix_(place[j], place[m])]
