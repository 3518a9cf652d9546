"""Nodal sums completed over ranks, with messages between neighbouring ranks only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints


class Halo:
    """Exchanges the parts of nodal sums that ranks hold.

    Every rank that holds a node receives the parts of all others and adds them in the order of
    the ranks, so all ranks get the same bits.

    Parameters
    ----------
    comm : mpi4py communicator or None
    shared : mapping
        For each neighbouring rank, the nodes that both hold, in the same order on both.
    """

    def __init__(self, comm: Any, shared: Mapping[int, Ints]) -> None:
        self._comm, self._shared = comm, dict(sorted(shared.items()))
        self._nodes = np.unique(np.concatenate([np.empty(0, np.int64), *self._shared.values()]))

    def complete(self, *fields: Floats) -> None:
        """Add the other ranks' parts of nodal sums ``(size, k)``, in place; collective."""
        if not self._shared:
            return
        width = sum(field.shape[1] for field in fields)
        received = {rank: np.empty((ids.size, width)) for rank, ids in self._shared.items()}
        requests = [self._comm.Irecv(part, source=rank) for rank, part in received.items()]
        sent = {
            rank: np.concatenate([field[ids] for field in fields], axis=1)
            for rank, ids in self._shared.items()
        }
        requests += [self._comm.Isend(part, dest=rank) for rank, part in sent.items()]
        own = [field[self._nodes] for field in fields]
        for field in fields:
            field[self._nodes] = 0.0
        for request in requests:
            request.Wait()
        for rank in sorted([*received, self._comm.rank]):
            column = 0
            for field, part in zip(fields, own, strict=True):
                if rank == self._comm.rank:
                    field[self._nodes] += part
                else:
                    wide = received[rank][:, column : column + field.shape[1]]
                    field[self._shared[rank]] += wide
                column += field.shape[1]
