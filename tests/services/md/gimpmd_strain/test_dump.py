"""Text dumps of LAMMPS: read, and written again."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_strain.dump import atoms_of, frames, index, read_frame, write_frame
from tests.services.md.gimpmd_strain.dumps import table

Strip = Callable[..., Path]

WAYS = {
    "images": "id x y z ix iy iz",
    "unwrapped": "id xu yu zu",
    "scaled": "id xs ys zs ix iy iz",
    "scaled, unwrapped": "id xsu ysu zsu",
}
DUMP = """ITEM: TIMESTEP
0
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS pp ss pp
0 4
0 4
-0.5 0.5
ITEM: ATOMS id type element x y z
2 1 Cu 3.5 0.25 0
1 1 Cu 0.5 0.25 0
"""


@pytest.mark.parametrize(
    "tilt", ["", "change_box all triclinic\nchange_box all xy final 3.0 remap units box"]
)
def test_every_way_of_writing_positions(strip: Strip, tilt: str) -> None:
    """Drifting across periodic faces, LAMMPS's own unwrapped positions are the reference."""
    more = f"velocity all set 30 -20 0 sum yes units box\n{tilt}"
    last = {}
    for name, columns in WAYS.items():
        path = strip("some.dump", columns, "p p p", more)
        frame = list(frames(path))[-1]
        atoms = atoms_of(path, frame)
        assert atoms.unwrapped
        last[name] = atoms.x[np.argsort(atoms.ids)]
    exact = table(strip("other.dump", "id xu yu zu", "p p p", more), "xu yu zu")[-1][1]
    assert exact[:, 0].max() > 20.0  # the box ends at 13.4
    for name, x in last.items():
        np.testing.assert_allclose(x, exact, atol=1e-12, err_msg=name)


def test_box_masses_and_steps(strip: Strip) -> None:
    path = strip(
        boundary="p p p",
        more="change_box all triclinic\nchange_box all xy final 2.0 remap units box",
    )
    found = list(frames(path))
    assert [frame.step for frame in found] == [0, 50, 100, 150]
    box = found[-1].box(2)
    a = (2.0 / 3**0.5 / 0.9317984) ** 0.5
    exact = np.array([[12 * a, 2.0], [0.0, 6 * 3**0.5 * a]])
    np.testing.assert_allclose(box.edges, exact, atol=1e-12)
    np.testing.assert_allclose(box.origin, 0.0, atol=1e-12)
    assert box.periodic.all()
    m = atoms_of(path, found[0]).m
    assert set(m) == {1.0, 1.5}


def test_zipped_and_cut_off(tmp_path: Path, strip: Strip) -> None:
    path = strip()
    whole = list(frames(path))
    zipped = tmp_path / "atoms.dump.gz"
    zipped.write_bytes(gzip.compress(path.read_bytes()))
    assert [frame.rows for frame in frames(zipped)] == [frame.rows for frame in whole]
    text = path.read_bytes()
    for less in (1, 30, 5000, len(text) - text.rfind(b"ITEM: TIMESTEP") - 16):
        path.write_bytes(text[:-less])
        assert [frame.step for frame in frames(path)] == [0, 50, 100]


@pytest.mark.parametrize("zipped", [False, True])
def test_frames_are_read_in_any_order(tmp_path: Path, zipped: bool) -> None:
    path = tmp_path / "a.dump"
    text = DUMP + DUMP.replace("TIMESTEP\n0", "TIMESTEP\n50").replace("3.5", "3.75")
    text += DUMP.replace("TIMESTEP\n0", "TIMESTEP\n100")[:-4]  # cut off
    path.write_bytes(gzip.compress(text.encode()) if zipped else text.encode())
    places = index(path)
    assert [(place.step, place.atoms) for place in places] == [(0, 2), (50, 2)]
    assert places[1].columns == ["id", "type", "element", "x", "y", "z"]
    in_order = list(frames(path))
    for place, frame in zip(reversed(places), reversed(in_order), strict=True):
        found = read_frame(path, place)
        assert (found.step, found.rows, found.head) == (frame.step, frame.rows, frame.head)
    assert read_frame(path, places[1]).numbers(["x"])[0, 0] == 3.75


def test_a_frame_that_is_gone_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.dump"
    path.write_text(DUMP + DUMP.replace("TIMESTEP\n0", "TIMESTEP\n50"))
    last = index(path)[-1]
    path.write_text(DUMP)
    with pytest.raises(InputError, match="frame of step 50: has changed or is gone"):
        read_frame(path, last)
    path.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        index(path)


def test_writing_keeps_every_line(tmp_path: Path) -> None:
    """Words and order of the dump stay; numbers are added."""
    path = tmp_path / "a.dump"
    path.write_text(DUMP)
    (frame,) = frames(path)
    file = io.BytesIO()
    write_frame(file, frame, ["strain_xx", "strain_yy"], np.array([[0.25, np.nan], [-1e-7, 2.0]]))
    expected = DUMP.replace("x y z\n", "x y z strain_xx strain_yy\n")
    expected = expected.replace("3.5 0.25 0\n", "3.5 0.25 0 0.25 nan\n")
    expected = expected.replace(" 0.5 0.25 0\n", " 0.5 0.25 0 -1e-07 2\n")
    assert file.getvalue().decode() == expected


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ITEM: TIMESTEP", "mass 1", "is not a LAMMPS text dump: it does not begin with ITEM:"),
        ("\n2\nITEM: BOX", "\ntwo\nITEM: BOX", "is not a LAMMPS text dump"),
        ("BOUNDS pp ss pp", "BOUNDS abc origin", "triclinic/general no"),
        ("0 4\n0 4", "0 4\n4 0", "box of zero volume"),
        ("id type", "ID type", "has no column id; it has ID type"),
        ("x y z", "x y vz", "has no column x y z"),
        ("1 1 Cu 0.5", "1 1 Cu abc", "a row that is not an atom"),
        ("1 1 Cu 0.5", "1 1 Cu nan", "an atom whose position is not finite"),
        ("1 1 Cu", "2 1 Cu", "two atoms of the same id"),
        ("type element", "mass element", None),
        ("2 1 Cu 3.5", "2 -1 Cu 3.5", None),
        ("ITEM: BOX BOUNDS pp ss pp\n0 4\n0 4\n-0.5 0.5\n", "", "before the atoms"),
    ],
)
def test_bad_dumps_are_refused(tmp_path: Path, old: str, new: str, words: str | None) -> None:
    path = tmp_path / "bad.dump"
    assert old in DUMP
    path.write_text(DUMP.replace(old, new, 1))
    if words is None:
        assert [len(atoms_of(path, frame).ids) for frame in frames(path)] == [2]
        return
    with pytest.raises(InputError, match=rf"bad\.dump: 1 problem\n.*{words}|{words}"):
        [atoms_of(path, frame) for frame in frames(path)]


def test_masses_must_be_positive(tmp_path: Path) -> None:
    path = tmp_path / "bad.dump"
    path.write_text(DUMP.replace("type element", "mass element").replace("2 1 Cu", "2 0 Cu"))
    with pytest.raises(InputError, match="an atom whose mass is not positive"):
        [atoms_of(path, frame) for frame in frames(path)]


def test_missing_files_and_binary_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        list(frames(tmp_path / "none.dump"))
    with pytest.raises(InputError, match="cannot be read"):
        list(frames(tmp_path))
    (tmp_path / "binary").write_bytes(bytes(range(256)) * 20)
    with pytest.raises(InputError, match="not a LAMMPS text dump"):
        list(frames(tmp_path / "binary"))
    (tmp_path / "short.gz").write_bytes(gzip.compress(DUMP.encode())[:-20])
    with pytest.raises(InputError, match="cannot be read"):
        list(frames(tmp_path / "short.gz"))
