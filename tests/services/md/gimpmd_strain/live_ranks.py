"""MPI program: strains of a script's atoms by all methods. ``live_ranks.py SCRIPT OUT``."""

from __future__ import annotations

import sys

import numpy as np
from lammps import lammps
from mpi4py import MPI

from gimpmd_strain.live import LiveStrain
from gimpmd_strain.settings import Settings


def main() -> None:
    comm = MPI.COMM_WORLD
    script, out = sys.argv[1:]
    results, moved = {}, 0
    for method in ("incremental", "total", "virial"):
        instance = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"], comm=comm)
        instance.file(script)
        live = LiveStrain(instance, Settings(method=method))

        def ids(instance=instance):
            return instance.numpy.extract_atom("id")[: instance.extract_setting("nlocal")].copy()

        at_first = set(ids().tolist())
        for _ in range(3):
            instance.command("run 50")
            strain = live.update()
        moved = len(set(ids().tolist()) - at_first)
        all_ids, all_strain = comm.gather(ids()), comm.gather(strain)
        if comm.rank == 0:
            results[method] = np.concatenate(all_strain)[np.argsort(np.concatenate(all_ids))]
        instance.close()
    if comm.rank == 0:
        np.savez(out, moved=moved, **results)


if __name__ == "__main__":
    main()
