"""Memory that the correction takes while it is found, counted from its equations.

Every node near the planes has an equation for each component and strain. Most of the memory is that
of the normal matrix of these equations and of its factors. Both follow from which nodes have pieces
in common, so they are counted before there are any numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import psutil

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.correction import System, change_numbers, corrected, weights
from gimpmd_gimp.coupling.sites.layout import Layout
from gimpmd_gimp.coupling.sites.least_norm import superlu
from gimpmd_gimp.coupling.sites.multifrontal import dissect, memory
from gimpmd_gimp.coupling.sites.shells import faces_met
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.answers import CorrectionSize

NUMBER, INDEX = 8, 8
"""Bytes of an entry of the normal matrix, and of its place in it."""

FACTOR = 12
"""Bytes of an entry of the factors of SuperLU, with its place."""

VECTORS = 10
"""Vectors that `least_norm` holds at a time, with those inside its products."""


def size_of_correction(layout: Layout) -> CorrectionSize:
    """Count the equations of a correction, and the bytes that a rank needs to solve them.

    The gradient term, which some orientations of the crystal need, is not counted.
    """
    grid = layout.grid
    pieces = layout.pieces.take(corrected(layout.pieces, layout.shells, grid.cell))
    slopes, reached, _ = weights(grid, pieces, layout.T)
    nodes, numbers = np.flatnonzero(reached), change_numbers(grid.dim)
    G = [slope.tocsc()[:, nodes].tocsr() for slope in slopes]
    system = System(G, np.sqrt(pieces.volume), numbers)
    graph, k = system.graph(), grid.dim * numbers.shape[2]
    # at faces of the body strains are mixed, so all equations of two nodes may be bound
    entries = graph.nnz * (k * k if faces_met(grid, layout.shells) else system.bound())
    if grid.dim == 3:
        factors, most = memory(dissect(graph, grid.positions()[nodes]), k)
    else:
        factors = most = FACTOR * k * k * _fill(graph)
    vectors = VECTORS * NUMBER * system.of_pieces
    # the normal matrix, and a copy that is scaled and shares the places
    matrix = (2 * NUMBER + INDEX) * entries
    return CorrectionSize(equations=k * nodes.size, memory=matrix + max(most, factors + vectors))


def check_room(size: CorrectionSize, comm: Any) -> None:
    """Check that all ranks of this host have room for a correction; collective.

    Parameters
    ----------
    comm : mpi4py communicator or None
        Of all ranks of the continuum.

    Raises
    ------
    BackendError
        They need more than the free memory of the host.
    """
    ranks, free = 1, psutil.virtual_memory().available
    if comm is not None:
        from mpi4py import MPI

        host = comm.Split_type(MPI.COMM_TYPE_SHARED)
        ranks, free = host.size, host.allreduce(free, MPI.MIN)
        host.Free()
    if ranks * size.memory > free:
        raise BackendError(
            f"coupling.scheme: sites: the correction has {size.equations:,} equations and takes "
            f"about {size.memory / 1e9:.2g} GB in every continuum rank; {ranks} of them run on "
            f"this host, which has {free / 1e9:.2g} GB of memory free: use fewer continuum.ranks, "
            "larger cells (grid.cell), or a smaller md.region"
        )


def _fill(graph: Sparse) -> int:
    """Entries of the factors of a matrix with one row for each node, in SuperLU's order."""
    A = graph.tocsr()
    A.data[:] = -1.0
    A.setdiag(np.diff(A.indptr).astype(float))  # dominant, so the factors exist
    return int(superlu(A).nnz)
