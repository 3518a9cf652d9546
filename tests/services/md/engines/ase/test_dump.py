"""Dumps that other code of ours reads as those of LAMMPS; `test_atoms` compares their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gimpmd_md.engines.ase.dump import append_frame, begin_dump
from gimpmd_strain import dump


def test_frames_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "atoms" / "atoms.dump"
    begin_dump(path)
    x = np.array([[0.5, 1.5, 0.0], [2.5, 0.25, 0.0]])
    box = np.array([[0.0, 3.0], [-1.0, 4.0], [-0.5, 0.5]])
    for step in (0, 40):
        columns = {"id": np.array([1, 2]), "type": np.array([1, 1])}
        columns |= dict(zip("xyz", x.T + step, strict=True))
        append_frame(path, step, box, np.array([True, False, False]), columns)
    first, last = dump.frames(path)
    assert (first.step, last.step) == (0, 40)
    assert last.periodic.tolist() == [True, False, False]
    np.testing.assert_allclose(np.column_stack([last.low, last.high]), box)
    np.testing.assert_allclose(dump.atoms_of(path, last).x, x + 40)
