"""Memory use of this process."""

from __future__ import annotations

import numpy as np

from gimpmd_coupler.memory import peak_memory


def test_the_peak_counts_bytes_and_never_falls() -> None:
    before = peak_memory()
    block = np.ones(8 * 2**20)  # 64 MiB
    grown = peak_memory()
    assert grown >= block.nbytes
    del block
    assert peak_memory() >= grown >= before
