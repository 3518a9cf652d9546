"""Files of a run, written by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from gimpmd_deploy.results.energies import SCALARS
from gimpmd_schemas.record_format import FORMAT_VERSION

FRAME = """\
ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
4
ITEM: BOX BOUNDS ss ss pp
0 2
0 2
-0.5 0.5
ITEM: ATOMS id type x y z vx vy ux uy X0 Y0 sxx_area syy_area sxy_area
3 1 0 2.5 0 0 0 0 0.5 0 2 0 12 0
1 1 0.1 0 0 7 8 0.1 0 0 0 4 8 1
2 2 2 0 0 0 0 0 0 2 0 0 8 0
4 1 2 2 0 0 0 0 0 2 2 0 8 0
"""
"""A frame of a dump in two dimensions; atoms of a square lattice of spacing 2."""


def write_record(
    path: Path,
    energies: Sequence[float],
    work: Sequence[float],
    interface_work: object = 0.0,
    dim: int = 2,
) -> None:
    """Write a ``run.h5`` of MD only: kinetic energy at every half unit of time."""
    steps = len(work)
    with h5py.File(path, "w") as file:
        file.attrs.update(format=FORMAT_VERSION, outcome="completed", wall_time=90.0)
        file.attrs.update(start="2025-01-01T00:00:00+00:00", end="2025-01-01T00:02:00+00:00")
        file["series/time"] = np.arange(steps) * 0.5
        given = {"kinetic": energies, "external_work": work}
        for name in SCALARS:
            if name != "interface_work":
                file[f"series/md/{name}"] = given.get(name, np.zeros(steps))
        file["series/md/interface_work"] = np.zeros(steps) + interface_work
        for k, axis in enumerate("xyz"[:dim]):
            file[f"series/md/momentum_{axis}"] = np.full(steps, 1.0 + k)
        file["series/total/energy"] = energies
        file["series/total/external_work"] = work
        file["series/total/fix_work"] = np.zeros(steps)
        file["series/total/dissipated"] = np.zeros(steps)
        file["timings/md/lammps"] = np.tile([2.0, 4.0], (steps, 1))
        file["timings/md/wait"] = np.tile([1.0, 0.0], (steps, 1))
        file["memory/md"] = np.array([[10, 7], [30, 8], [20, 9]])
