"""Tables of the embedded-atom method, interpolated as LAMMPS does it.

LAMMPS's ``pair_style eam`` puts a cubic on each interval of a table [1]_. Its slopes at the points
are differences of fourth order, of second order next to an end, and one-sided at an end.

.. [1] ``PairEAM::interpolate`` in LAMMPS, src/MANYBODY/pair_eam.cpp.
"""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Floats


def cubics(values: Floats) -> Floats:
    """Cubics on the intervals of a table.

    Parameters
    ----------
    values : ndarray, shape ``(n,)``
        At evenly spaced points, five or more.

    Returns
    -------
    ndarray, shape ``(n - 1, 4)``
        Coefficients of the part f of an interval, the highest power first.
    """
    f, slope = values, np.empty_like(values)
    slope[0], slope[-1] = f[1] - f[0], f[-1] - f[-2]
    slope[1], slope[-2] = 0.5 * (f[2] - f[0]), 0.5 * (f[-1] - f[-3])
    slope[2:-2] = ((f[:-4] - f[4:]) + 8.0 * (f[3:-1] - f[1:-3])) / 12.0
    rise = np.diff(f)
    bend = 3.0 * rise - 2.0 * slope[:-1] - slope[1:]
    twist = slope[:-1] + slope[1:] - 2.0 * rise
    return np.column_stack([twist, bend, slope[:-1], f[:-1]])


def interpolate(table: Floats, step: float, x: Floats) -> Floats:
    """Values of a table at some places.

    Beyond its ends the table continues with its last cubic, and then with its last value.

    Parameters
    ----------
    table : ndarray, shape ``(n - 1, 4)``
        See `cubics`.
    step : float
        Distance of its points; the first is at 0.
    """
    place = x / step
    at = np.clip(place.astype(int), 0, len(table) - 1)
    part = np.minimum(place - at, 1.0)
    c = table[at]
    return np.asarray(((c[..., 0] * part + c[..., 1]) * part + c[..., 2]) * part + c[..., 3])
