"""The patch layout changes results by round-off alone."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
LAYOUTS = [(1, 1), (2, 1), (1, 2), (2, 2)]
WINDOWS = 30


@pytest.fixture(scope="module", params=["velocity", "current", "force", "absorber"])
def results(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> dict[tuple[int, int], dict]:
    folder = tmp_path_factory.mktemp("patches")
    shutil.copy(HERE / "scripts/block.in", folder)
    mpiexec = Path(sys.executable).parent / "mpiexec"
    found = {}
    for px, py in LAYOUTS:
        out = folder / f"patches{px}x{py}.npz"
        command = [mpiexec, "-n", str(px * py), sys.executable, HERE / "drive.py"]
        command += [str(px), str(py), str(WINDOWS), request.param, out]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        found[px, py] = dict(np.load(out))
    return found


@pytest.mark.parametrize("layout", LAYOUTS[1:])
def test_patches_agree_to_round_off(results: dict, layout: tuple[int, int]) -> None:
    one, many = results[1, 1], results[layout]
    np.testing.assert_array_equal(one["ids"], many["ids"])  # each node has exactly one owner
    for name in set(one) - {"ids"}:
        scale = np.abs(one[name]).max()
        assert scale > 0.01
        np.testing.assert_allclose(
            many[name], one[name], rtol=0.0, atol=1e-11 * scale, err_msg=name
        )


def test_atoms_move_and_strain(results: dict) -> None:
    """The test above is worth something only if atoms change patches and the body strains."""
    _, x, v, rest = np.split(results[1, 1]["atoms"], 4, axis=1)
    u = x - rest
    assert u[:, 0].max() > 0.55
    assert u[:, 1].min() < -0.45
    assert np.ptp(u, axis=0).min() > 0.02
    assert np.ptp(v, axis=0).min() > 0.02
