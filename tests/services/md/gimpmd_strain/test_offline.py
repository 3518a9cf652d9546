"""``gimpmd-md strain``: strains of a dump, on any number of ranks."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.services.md.gimpmd_strain.dumps import table

Strip = Callable[..., Path]
Strain = Callable[..., subprocess.CompletedProcess[str]]

XX_YY_XY = "strain_xx strain_yy strain_xy"
ALL = "strain_xx strain_yy strain_zz strain_xy strain_xz strain_yz"
METHODS = ("incremental", "total", "virial")


def strained(x: np.ndarray, step: int) -> np.ndarray:
    """A shear and stretch that grows with the step."""
    H = step / 150 * np.array([[0.02, 0.03], [-0.01, -0.015]])
    return x @ (np.eye(2) + H).T


def write(path: Path, frames: list[tuple[int, np.ndarray]], free: bool = True) -> None:
    """A dump of atoms of a plane, wrapped by nobody."""
    with path.open("w") as file:
        for step, x in frames:
            low, high = x.min(axis=0), x.max(axis=0)
            flag = "ss" if free else "pp"
            file.write(f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(x)}\n")
            file.write(f"ITEM: BOX BOUNDS {flag} {flag} pp\n")
            file.write(f"{low[0]:.17g} {high[0]:.17g}\n{low[1]:.17g} {high[1]:.17g}\n-0.5 0.5\n")
            file.write("ITEM: ATOMS id x y z\n")
            file.writelines(f"{i + 1} {a:.17g} {b:.17g} 0\n" for i, (a, b) in enumerate(x))


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    """A free hexagonal plate strained uniformly, in steps of 50."""
    rows = [[(i + 0.5 * (j % 2), j * 0.75**0.5) for i in range(15)] for j in range(12)]
    x = np.array(rows).reshape(-1, 2)
    path = tmp_path / "plate.dump"
    write(path, [(step, strained(x, step)) for step in (0, 50, 100, 150)])
    return path


@pytest.mark.parametrize("options", [(), ("--cell", "1.7"), ("--spacing", "0.9")])
def test_uniform_strain_is_exact_at_every_atom(
    plate: Path, strain: Strain, options: tuple[str, ...]
) -> None:
    done = strain(plate, "--method", "total", *options)
    assert done.returncode == 0, done.stderr
    out = plate.parent / "out.dump"
    assert [step for step, _ in table(out, "id")] == [0, 50, 100, 150]
    for step, found in table(out, XX_YY_XY):
        exact = step / 150 * np.array([0.02, -0.015, 0.01])
        np.testing.assert_allclose(found, np.broadcast_to(exact, found.shape), atol=1e-9)


def test_increments_are_small_strains_of_the_moving_body(plate: Path, strain: Strain) -> None:
    """Their sum differs from the total strain by its square at most."""
    assert strain(plate, "--method", "incremental").returncode == 0
    _, found = table(plate.parent / "out.dump", XX_YY_XY)[-1]
    exact = np.array([0.02, -0.015, 0.01])
    assert np.abs(found - exact).max() < 0.03**2
    assert np.ptp(found, axis=0).max() < 1e-8


def test_measures(plate: Path, strain: Strain) -> None:
    F = strained(np.eye(2), 150).T
    exact = {
        "green": 0.5 * (F.T @ F - np.eye(2)),
        "almansi": 0.5 * (np.eye(2) - np.linalg.inv(F @ F.T)),
    }
    for measure, tensor in exact.items():
        assert strain(plate, "--method", "total", "--measure", measure).returncode == 0
        _, found = table(plate.parent / "out.dump", XX_YY_XY)[-1]
        expected = np.broadcast_to([tensor[0, 0], tensor[1, 1], tensor[0, 1]], found.shape)
        np.testing.assert_allclose(found, expected, atol=1e-9)
    assert strain(plate, "--method", "virial").returncode == 0
    _, found = table(plate.parent / "out.dump", XX_YY_XY)[-1]
    inner = np.isfinite(found).all(axis=1)
    # half the atoms of the faces along y have three neighbours at 120 degrees, two corners at 60
    assert inner.sum() == 13 * 10 + 10 + 2
    np.testing.assert_allclose(found[inner], expected[inner], atol=1e-9)


def test_reference_by_step_and_by_file(plate: Path, strain: Strain) -> None:
    out = plate.parent / "out.dump"
    assert strain(plate, "--method", "total", "--reference", "50").returncode == 0
    by_step = table(out, XX_YY_XY)
    assert [step for step, _ in by_step] == [50, 100, 150]
    np.testing.assert_allclose(by_step[0][1], 0.0, atol=1e-12)
    later = plate.parent / "from 50.dump"
    text = plate.read_text()
    later.write_text(text[text.index("ITEM: TIMESTEP\n50") : text.index("ITEM: TIMESTEP\n100")])
    assert strain(plate, "--method", "total", "--reference", str(later)).returncode == 0
    by_file = table(out, XX_YY_XY)
    assert [step for step, _ in by_file] == [0, 50, 100, 150]
    for (_, a), (_, b) in zip(by_step, by_file[1:], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    assert by_file[0][1][0, 0] == pytest.approx(-0.02 / 3, rel=0.02)


def test_wrapped_atoms_without_images_are_followed(tmp_path: Path, strain: Strain) -> None:
    """A periodic crystal drifts and waves across its faces; only wrapped positions are written."""
    n, m = 20, 12
    edges = np.array([n, m * 3**0.5 / 2])
    grid = [[(i + 0.5 * (j % 2), j * 0.75**0.5) for i in range(n)] for j in range(m)]
    X = np.array(grid).reshape(-1, 2)
    frames = []
    for k in range(5):
        wave = np.sin(2.0 * np.pi * X / edges)[:, ::-1]
        frames.append((k, X + k * (0.01 * wave + [3.3, -2.1])))
    whole, wrapped = tmp_path / "whole.dump", tmp_path / "wrapped.dump"
    bounds = f"0 {edges[0]:.17g}\n0 {edges[1]:.17g}\n"
    for path, fold in ((whole, False), (wrapped, True)):
        write(path, [(k, x % edges if fold else x) for k, x in frames], free=False)
        lines = path.read_text().splitlines(keepends=True)
        for i in [i for i, line in enumerate(lines) if line.startswith("ITEM: BOX")]:
            lines[i + 1 : i + 3] = bounds.splitlines(keepends=True)
        path.write_text("".join(lines).replace("x y z", "x y z" if fold else "xu yu zu"))
    for method in METHODS:
        assert strain(whole, "--method", method, out="a.dump").returncode == 0
        assert strain(wrapped, "--method", method, out="b.dump").returncode == 0
        a = table(tmp_path / "a.dump", XX_YY_XY)[-1][1]
        b = table(tmp_path / "b.dump", XX_YY_XY)[-1][1]
        assert np.abs(a).max() > 0.005
        np.testing.assert_allclose(a, b, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("solid", "boundary"),
    [
        (False, "s s p"),
        pytest.param(False, "p s p", marks=pytest.mark.long),
        pytest.param(True, "s s s", marks=pytest.mark.long),
        (True, "p s p"),
        pytest.param(True, "p p p", marks=pytest.mark.long),
    ],
)
def test_ranks_agree_to_round_off(
    strip: Strip, strain: Strain, method: str, boundary: str, solid: bool
) -> None:
    path = strip(boundary=boundary, solid=solid)
    assert strain(path, "--method", method, out="one.dump").returncode == 0
    assert strain(path, "--method", method, out="two.dump", ranks=2).returncode == 0
    one, two = (path.with_name(f"{name}.dump") for name in ("one", "two"))
    columns = ALL if solid else XX_YY_XY
    for (step, a), (_, b) in zip(table(one, columns), table(two, columns), strict=True):
        assert (step == 0) == (np.nanmax(np.abs(a)) < 1e-14)
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-12)  # nine digits are written


def test_three_dimensions_in_a_box_that_shears(tmp_path: Path, strain: Strain) -> None:
    """LAMMPS strains a periodic fcc cell past the flip of its tilt; the strain is the box's."""
    from tests.services.md.gimpmd_strain.dumps import lammps_runs

    rate, end = 0.3, 2.0  # xy = 0.6 of the height: flips at 0.5
    lammps_runs(
        f"units lj\nboundary p p p\nlattice fcc 1.0\nregion b prism 0 4 0 4 0 4 0 0 0\n"
        f"create_box 1 b\ncreate_atoms 1 box\nmass 1 1\npair_style lj/cut 2.5\n"
        f"pair_coeff 1 1 1 1\ntimestep 0.002\n"
        f"fix 1 all deform 1 xy erate {rate} z erate 0.05 remap x flip yes\n"
        f"dump 1 all custom 100 {tmp_path}/box.dump id x y z ix iy iz\n"
        f"dump_modify 1 format float %.15g\nrun {end / 0.002:.0f}\n"
    )
    text = (tmp_path / "box.dump").read_text()
    height = 4 * 4 ** (1 / 3)
    tilts = [float(line.split()[2]) for line in text.splitlines() if line.count(" ") == 2]
    assert min(tilts) < -0.3 * height  # it did flip
    H = np.zeros((3, 3))
    H[0, 1], H[2, 2] = rate * end, 0.05 * end
    F = np.eye(3) + H
    done = strain(tmp_path / "box.dump", "--method", "total")
    assert json.loads(done.stdout)["dimension"] == 3
    found = table(tmp_path / "out.dump", ALL)[-1][1]
    exact = [0.0, 0.0, H[2, 2], 0.5 * H[0, 1], 0.0, 0.0]
    np.testing.assert_allclose(found, np.broadcast_to(exact, found.shape), atol=1e-6)
    assert strain(tmp_path / "box.dump", "--method", "virial").returncode == 0
    found = table(tmp_path / "out.dump", ALL)[-1][1]
    almansi = 0.5 * (np.eye(3) - np.linalg.inv(F @ F.T))
    exact = almansi[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found, np.broadcast_to(exact, found.shape), atol=1e-6)


def test_the_summary_says_what_was_done(plate: Path, strain: Strain) -> None:
    summary = json.loads(strain(plate, "--method", "virial").stdout)
    assert summary["distance"] == pytest.approx(1.0)
    assert summary["cutoff"] == pytest.approx(1.2)
    assert summary["cell"] is None
    assert (summary["atoms"], summary["frames"], summary["dimension"]) == (180, 4, 2)
    assert summary["undefined"] == 38
    assert json.loads(strain(plate).stdout)["cell"] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cell", "0.5"), "cell = 0.5: is smaller than an atom, which is 1 wide"),
        (("--method", "viral"), "method = 'viral': is unknown"),
        (("--reference", "70"), "reference = 70: is not a step of it"),
        (("--reference", "none.dump"), "none.dump: 1 problem"),
    ],
)
def test_bad_options_are_one_clear_error(
    plate: Path, strain: Strain, options: tuple[str, ...], words: str
) -> None:
    done = strain(plate, *options)
    assert done.returncode == 2
    assert done.stderr.count("problem") == 1
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(plate.parent.glob("out.dump*"))


def test_all_ranks_end_when_one_finds_an_error(plate: Path, strain: Strain) -> None:
    done = strain(plate, "--reference", "70", ranks=2)
    assert done.returncode == 2
    assert done.stderr.count("problem") == 1


def test_an_atom_that_gets_lost_is_named(plate: Path, strain: Strain) -> None:
    lines = plate.read_text().splitlines(keepends=True)
    at = max(i for i, line in enumerate(lines) if line.startswith("7 "))
    del lines[at]
    last = max(i for i, line in enumerate(lines) if line == "180\n")
    lines[last] = "179\n"
    plate.write_text("".join(lines))
    for ranks in (1, 2):
        done = strain(plate, ranks=ranks)
        assert done.returncode == 2
        assert "frame of step 150: has 179 atoms, the reference 180; atom 7 is missing" in (
            done.stderr
        )
        assert not list(plate.parent.glob("out.dump*"))


def test_strains_are_not_added_twice(plate: Path, strain: Strain) -> None:
    assert strain(plate).returncode == 0
    done = strain(plate.parent / "out.dump", out="again.dump")
    assert done.returncode == 2
    assert "has a column strain_xx already" in done.stderr
    done = strain(plate, out="plate.dump")
    assert done.returncode == 2
    assert "is the dump itself" in done.stderr
