"""The domain integral of Eshelby's energy-momentum tensor, of which J-integrals are made."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Floats


def domain_integral(volume: Floats, P: Floats, H: Floats, density: Floats, dq: Floats) -> float:
    """Integrate ``P_ij H_i1 q,j - w q,1`` over particles (Moran and Shih 1987).

    ``q`` is a weight between 1 at a crack tip and 0 far from it, and axis 1 is the direction of
    growth.

    Parameters
    ----------
    volume : ndarray, shape ``(n,)``
        Reference volumes of the particles.
    P, H : ndarray, shape ``(n, 2, 2)``
        First Piola-Kirchhoff stress, and gradient of the displacement.
    density : ndarray, shape ``(n,)``
        Energy w per reference volume, in the unit of the stress.
    dq : ndarray, shape ``(n, 2)``
        Gradient of q.
    """
    work = np.einsum("n,nij,ni,nj", volume, P, H[:, :, 0], dq)
    return float(work - (volume * density) @ dq[:, 0])
