"""The atoms as a LAMMPS text dump, with the columns that LAMMPS itself writes in a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints

IN_PLANE = ("vx vy ux uy X0 Y0", ("sxx_area", "syy_area", "sxy_area"), (0, 1, 5))
IN_SPACE = (
    "vx vy vz ux uy uz X0 Y0 Z0",
    ("sxx_volume", "syy_volume", "szz_volume", "syz_volume", "sxz_volume", "sxy_volume"),
    (0, 1, 2, 3, 4, 5),
)
"""Names of vectors and of stresses, and where ASE has these stresses."""


def begin_dump(path: Path) -> None:
    """Make an empty dump, and its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")


def append_frame(
    path: Path,
    step: int,
    box: Floats,
    periodic: Bools,
    columns: Mapping[str, Floats | Ints],
) -> None:
    """Append one frame.

    Parameters
    ----------
    path : Path
    step : int
        MD step.
    box : ndarray, shape ``(3, 2)``
    periodic : ndarray of bool, shape ``(3,)``
    columns : mapping of str to ndarray, shape ``(n,)``
        After the columns ``id`` and ``type``.
    """
    data = np.column_stack(list(columns.values()))
    head = [
        "ITEM: TIMESTEP",
        str(step),
        "ITEM: NUMBER OF ATOMS",
        str(len(data)),
        "ITEM: BOX BOUNDS " + " ".join("pp" if p else "ff" for p in periodic),
        *(f"{low:.16e} {high:.16e}" for low, high in box),
        "ITEM: ATOMS " + " ".join(columns),
    ]
    integers = sum(name in ("id", "type") for name in columns)
    form = " ".join(["%d"] * integers + ["%.9g"] * (data.shape[1] - integers))
    with path.open("ab") as file:
        file.write(("\n".join(head) + "\n").encode())
        np.savetxt(file, data, fmt=form)
