"""The file with the stiffness of the atoms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import sparse

from gimpmd_schemas.wire.stiffness import Stiffness


def test_a_file_holds_what_was_written(tmp_path: Path) -> None:
    matrix = sparse.random_array((8, 8), density=0.3, rng=np.random.default_rng(1), format="csr")
    Stiffness(np.array([[0.0, 1.0], [2.0, 3.0]]), matrix).save(tmp_path / "s.npz")
    found = Stiffness.load(tmp_path / "s.npz")
    np.testing.assert_array_equal(found.x, [[0.0, 1.0], [2.0, 3.0]])
    np.testing.assert_array_equal(found.matrix.toarray(), matrix.toarray())
