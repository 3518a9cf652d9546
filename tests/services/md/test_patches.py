"""The patch layout changes results by round-off alone."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.coupling.halo import HALO_CELLS
from tests.mpi import MPIEXEC
from tests.services.md.block import CENTER, RATE

HERE = Path(__file__).parent
LAYOUTS = [(1, 1), (2, 1), (1, 2), (2, 2)]
SCHEMES = ("absorber", "velocity", "current", "force")
Layout = tuple[int, int]
Results = dict[Layout, dict[str, np.ndarray]]


def driven(
    folder: Path, scheme: str, motion: str, steps: int, layouts: Sequence[Layout]
) -> Results:
    """What comes of a motion on each layout of patches."""
    shutil.copy(HERE / "scripts/block.in", folder)
    found = {}
    for px, py in layouts:
        out = folder / f"patches{px}x{py}.npz"
        command = [MPIEXEC, "-n", str(px * py), sys.executable, HERE / "drive.py"]
        command += [str(px), str(py), str(steps), scheme, motion, out]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        found[px, py] = dict(np.load(out))
    return found


def check_equal(one: dict[str, np.ndarray], many: dict[str, np.ndarray], part: float) -> None:
    """All results agree to a part of the largest value."""
    np.testing.assert_array_equal(one["ids"], many["ids"])  # each node has exactly one owner
    for name in set(one) - {"ids", "away"}:
        scale = np.abs(one[name]).max()
        assert scale > 0.01
        np.testing.assert_allclose(many[name], one[name], rtol=0.0, atol=part * scale, err_msg=name)


Drifted = Callable[[str, Layout], dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def drifted(tmp_path_factory: pytest.TempPathFactory) -> Drifted:
    """What comes of a drift by a scheme on a layout of patches; each is run once."""

    @cache
    def run(scheme: str, layout: Layout) -> dict[str, np.ndarray]:
        folder = tmp_path_factory.mktemp("patches")
        return driven(folder, scheme, "drift", 30, [layout])[layout]

    return run


@pytest.mark.long
@pytest.mark.parametrize("layout", LAYOUTS[1:])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_patches_agree_to_round_off(drifted: Drifted, scheme: str, layout: Layout) -> None:
    check_equal(drifted(scheme, (1, 1)), drifted(scheme, layout), 1e-11)


@pytest.mark.long
def test_atoms_move_and_strain(drifted: Drifted) -> None:
    """The test above is worth something only if atoms change patches and the body strains."""
    _, x, v, rest = np.split(drifted("absorber", (1, 1))["atoms"], 4, axis=1)
    u = x - rest
    assert u[:, 0].max() > 0.55
    assert u[:, 1].min() < -0.45
    assert np.ptp(u, axis=0).min() > 0.02
    assert np.ptp(v, axis=0).min() > 0.02


TURNS = [("absorber", (2, 1)), ("absorber", (2, 2)), ("velocity", (2, 2))]


@pytest.mark.long
@pytest.mark.parametrize(("scheme", "layout"), TURNS)
def test_a_body_turns_through_a_right_angle_on_any_patches(
    tmp_path: Path, scheme: str, layout: tuple[int, int]
) -> None:
    """Every rank ends up with atoms of other patches, far beyond the halo of its own."""
    found = driven(tmp_path, scheme, "spin", 160, [(1, 1), layout])
    one, many = found[1, 1], found[layout]
    check_equal(one, many, 1e-9)
    assert many["away"] > HALO_CELLS
    site, x, _, rest = np.split(one["atoms"], 4, axis=1)
    c, s = np.cos(160 * 0.1 * RATE), np.sin(160 * 0.1 * RATE)
    turned = CENTER + (rest - CENTER) @ np.array([[c, s], [-s, c]])
    outside = np.abs(site - CENTER).max(axis=1) > 11.5  # boundary atoms in both schemes
    np.testing.assert_allclose(x[outside], turned[outside], atol=1e-10)
    assert 0.01 < np.abs(x - turned).max() < 1.0  # the others are drawn outward


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["velocity", "absorber"])
def test_halves_fly_and_slide_farther_than_a_patch(tmp_path: Path, scheme: str) -> None:
    """At speeds 1 and 2.5 along four patches of a period of 46.3, 11.6 each."""
    found = driven(tmp_path, scheme, "slide", 120, [(1, 1), (1, 4)])
    check_equal(found[1, 1], found[1, 4], 1e-7)
    assert found[1, 4]["away"] > HALO_CELLS
