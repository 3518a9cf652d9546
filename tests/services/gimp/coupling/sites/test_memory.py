"""The memory of a correction is that which its factors take."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from gimpmd_gimp.coupling.sites.correction import System, change_numbers, corrected, weights
from gimpmd_gimp.coupling.sites.least_norm import superlu
from gimpmd_gimp.coupling.sites.memory import FACTOR, check_room, size_of_correction
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.answers import CorrectionSize
from tests.benchmarks.correction_memory import layout


def test_the_count_of_a_square() -> None:
    """Against its normal matrix and the factors of this matrix."""
    found = layout(2, 20)
    pieces = found.pieces.take(corrected(found.pieces, found.shells, found.grid.cell))
    slopes, reached, _ = weights(found.grid, pieces, found.T)
    G = [slope[:, np.flatnonzero(reached)] for slope in slopes]
    system = System(G, np.sqrt(pieces.volume), change_numbers(2))
    K = system.normal()
    size = size_of_correction(found)
    assert size.equations == K.shape[0]
    graph = system.graph()
    # where terms cancel exactly, entries are missing
    assert 0.9 * graph.nnz * system.bound() < K.nnz <= graph.nnz * system.bound()
    K.setdiag(2.0 * K.diagonal())
    factors = size.memory - 24 * graph.nnz * system.bound()
    assert 1.0 < factors / (FACTOR * superlu(K).nnz) < 2.0  # blocks count as full


def test_room(monkeypatch: pytest.MonkeyPatch) -> None:
    size = CorrectionSize(equations=16_848, memory=3_000_000_000)
    for free in (3_000_000_001, 2_900_000_000):
        memory = SimpleNamespace(available=free)
        monkeypatch.setattr(psutil, "virtual_memory", lambda memory=memory: memory)
        if free > size.memory:
            check_room(size, None)
            continue
        with pytest.raises(
            BackendError, match=r"coupling\.scheme: sites: .*16,848 equations .*3 GB"
        ):
            check_room(size, None)
