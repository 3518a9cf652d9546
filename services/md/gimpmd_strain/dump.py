"""LAMMPS text dumps: read in order or at random, and written again with more columns.

``frames`` reads a dump from beginning to end. ``index`` finds where each frame begins, so that
``read_frame`` can read any of them.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain.box import Box
from gimpmd_strain.decimals import rows_of_decimals

_POSITIONS = (
    (("xu", "yu", "zu"), False, True),
    (("xsu", "ysu", "zsu"), True, True),
    (("x", "y", "z"), False, False),
    (("xs", "ys", "zs"), True, False),
)
"""Names of position columns, preferred ones first; whether they are scaled, and unwrapped."""


@dataclass(frozen=True)
class Frame:
    """One frame of a dump, as text.

    Attributes
    ----------
    step : int
        Time step.
    low, high : ndarray, shape ``(3,)``
        Corners of the box; those of a tilted box before it is tilted.
    tilts : ndarray, shape ``(3,)``
        xy, xz, yz.
    periodic : ndarray of bool, shape ``(3,)``
    columns : list of str
    head : list of bytes
        The lines before the one that names the columns.
    rows : list of bytes
        One line per atom, in the order of the dump.
    """

    step: int
    low: Floats
    high: Floats
    tilts: Floats
    periodic: Bools
    columns: list[str]
    head: list[bytes]
    rows: list[bytes]

    def box(self, dimension: int) -> Box:
        """The first ``dimension`` axes of the box."""
        return Box.of_lammps(self.low, self.high, self.tilts, self.periodic, dimension)

    def numbers(self, names: Sequence[str]) -> Floats:
        """Columns as numbers, shape ``(atoms, len(names))``.

        Raises
        ------
        ValueError
            A row is too short, or a value is not a number.
        """
        wanted = [self.columns.index(name) for name in names]
        text = b"".join(self.rows)
        found = rows_of_decimals(text, len(self.rows), np.array(wanted))
        if found is None:  # nan, numbers of very many digits, or a fault that numpy describes
            found = np.loadtxt(io.BytesIO(text), usecols=wanted, ndmin=2)
        return found.reshape(len(self.rows), len(names))


@dataclass(frozen=True)
class FrameIndex:
    """Where a frame is in its file.

    Attributes
    ----------
    step : int
        Time step.
    atoms : int
        Number of atoms.
    columns : list of str
    offset : int
        Byte at which the frame begins.
    """

    step: int
    atoms: int
    columns: list[str]
    offset: int


@dataclass(frozen=True)
class Atoms:
    """Numbers of one frame, in the order of the dump.

    Attributes
    ----------
    ids : ndarray of int64, shape ``(n,)``
    x : ndarray, shape ``(n, 3)``
        Positions, unwrapped if ``unwrapped``.
    m : ndarray, shape ``(n,)``
        Masses; one if the dump has no column ``mass``.
    """

    ids: Ints
    x: Floats
    m: Floats
    unwrapped: bool


def frames(path: Path) -> Iterator[Frame]:
    """Read the complete frames of a dump, also of a ``.gz`` file.

    A last frame that was cut off is left out.

    Raises
    ------
    InputError
        The file is missing, or it is not a text dump of LAMMPS.
    """
    with _opened(path) as file:
        while (frame := _frame(path, file)) is not None:
            yield frame


def index(path: Path) -> list[FrameIndex]:
    """Find the complete frames of a dump without reading their numbers.

    Raises
    ------
    InputError
        As for ``frames``.
    """
    found = []
    with _opened(path) as file:
        offset = 0
        while (head := _head(path, file)) is not None:
            row = b"\n"
            for _ in range(head.atoms):
                row = file.readline()
            if not row.endswith(b"\n"):
                break
            found.append(FrameIndex(head.step, head.atoms, head.columns, offset))
            offset = file.tell()
    return found


def read_frame(path: Path, place: FrameIndex) -> Frame:
    """Read one frame that ``index`` has found.

    Raises
    ------
    InputError
        The file has changed, or it cannot be read.
    """
    with _opened(path) as file:
        file.seek(place.offset)
        frame = _frame(path, file)
    if frame is None or frame.step != place.step:
        raise _no_dump(path, place.step, "has changed or is gone", "read the dump again")
    return frame


def atoms_of(path: Path, frame: Frame) -> Atoms:
    """Get ids, positions and masses of a frame.

    Raises
    ------
    InputError
        A column is missing, a value is not a number, or an id appears twice.
    """
    if "id" not in frame.columns:
        raise _no_columns(path, frame, "id")
    found = [kind for kind in _POSITIONS if set(kind[0]) <= set(frame.columns)]
    if not found:
        raise _no_columns(path, frame, "x y z")
    names, scaled, unwrapped = found[0]
    images = ["ix", "iy", "iz"] if {"ix", "iy", "iz"} <= set(frame.columns) else []
    mass = ["mass"] if "mass" in frame.columns else []
    try:
        data = frame.numbers(["id", *names, *images, *mass])
    except ValueError as error:
        raise _no_dump(path, frame.step, f"has a row that is not an atom: {error}") from None
    ids = data[:, 0].astype(np.int64)
    x = data[:, 1:4]
    if not np.isfinite(x).all():
        raise _no_dump(path, frame.step, "has an atom whose position is not finite (nan or inf)")
    if len(np.unique(ids)) != len(ids):
        raise _no_dump(path, frame.step, "has two atoms of the same id")
    box = frame.box(3)
    if scaled:
        x = box.origin + x @ box.edges.T
    if images and not unwrapped:
        x = x + data[:, 4:7] @ box.edges.T
    m = data[:, -1] if mass else np.ones(len(ids))
    if not (m > 0.0).all():
        raise _no_dump(path, frame.step, "has an atom whose mass is not positive")
    return Atoms(ids, x, m, unwrapped or bool(images))


def write_frame(file: IO[bytes], frame: Frame, names: Sequence[str], values: Floats) -> None:
    """Write a frame with additional columns ``values``, shape ``(atoms, len(names))``."""
    file.writelines(frame.head)
    file.write(b"ITEM: ATOMS " + " ".join([*frame.columns, *names]).encode() + b"\n")
    template = b" %.9g" * len(names) + b"\n"
    file.writelines(
        row.rstrip() + template % tuple(value)
        for row, value in zip(frame.rows, values.tolist(), strict=True)
    )


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a dump, compressed or not; errors of reading become an `InputError`."""
    try:
        with path.open("rb") as file:
            zipped = file.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if zipped else path.open("rb") as opened:
            yield opened  # type: ignore[misc]
    except (OSError, EOFError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise _no_dump(path, None, f"cannot be read: {reason}") from None


class _Head(NamedTuple):
    """The lines before the atoms: all but the last, and what they say."""

    lines: list[bytes]
    step: int
    atoms: int
    box_words: list[str]
    box_rows: list[list[float]]
    columns: list[str]


def _head(path: Path, file: IO[bytes]) -> _Head | None:
    """Read up to the first atom of the next frame; None at the end or if the file is cut off."""
    lines: list[bytes] = []
    step = atoms = None
    bounds: tuple[list[str], list[list[float]]] | None = None
    while line := file.readline():
        lines.append(line)
        try:
            if line.startswith(b"ITEM: TIMESTEP"):
                lines.append(file.readline())
                step = int(lines[-1])
            elif line.startswith(b"ITEM: NUMBER OF ATOMS"):
                lines.append(file.readline())
                atoms = int(lines[-1])
            elif line.startswith(b"ITEM: BOX BOUNDS"):
                lines += [file.readline() for _ in range(3)]
                words = line.decode().split()[3:]
                bounds = (words, [[float(word) for word in row.split()] for row in lines[-3:]])
            elif line.startswith(b"ITEM: ATOMS"):
                break
            elif not line.startswith(b"ITEM:") and len(lines) == 1:
                raise ValueError("it does not begin with ITEM:")
        except ValueError as error:
            if lines[-1].endswith(b"\n"):
                raise _no_dump(path, step, f"is not a LAMMPS text dump: {error}") from None
            return None  # cut off within the number
    else:
        return None
    if step is None or atoms is None or bounds is None:
        raise _no_dump(path, step, "does not give step, number of atoms and box before the atoms")
    columns = lines.pop().decode().split()[2:]
    return _Head(lines, step, atoms, *bounds, columns)


def _frame(path: Path, file: IO[bytes]) -> Frame | None:
    """Read the next frame; None at the end or if the file is cut off."""
    head = _head(path, file)
    if head is None:
        return None
    rows = [row for row in (file.readline() for _ in range(head.atoms)) if row]
    if len(rows) < head.atoms or (rows and not rows[-1].endswith(b"\n")):
        return None
    low, high, tilts, periodic = _box(path, head.step, head.box_words, head.box_rows)
    return Frame(head.step, low, high, tilts, periodic, head.columns, head.lines, rows)


def _box(
    path: Path, step: int, words: list[str], rows: list[list[float]]
) -> tuple[Floats, Floats, Floats, Bools]:
    tilted = words[:3] == ["xy", "xz", "yz"]
    flags = words[3:] if tilted else words
    if {len(row) for row in rows} != {3 if tilted else 2} or len(flags) != 3:
        hint = "write it with dump_modify triclinic/general no"
        message = f"has a box of an unknown kind: {' '.join(words)}"
        raise _no_dump(path, step, message, hint)
    low, high = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    tilts = np.array([row[2] for row in rows]) if tilted else np.zeros(3)
    if tilted:  # the bounds are those of the tilted box
        xy, xz, yz = tilts
        low -= [min(0.0, xy, xz, xy + xz), min(0.0, yz), 0.0]
        high -= [max(0.0, xy, xz, xy + xz), max(0.0, yz), 0.0]
    if not (high > low).all():
        raise _no_dump(path, step, "has a box of zero volume")
    return low, high, tilts, np.array([flag == "pp" for flag in flags])


def _no_columns(path: Path, frame: Frame, wanted: str) -> InputError:
    hint = f"write it with dump ... custom N FILE {wanted} ..."
    message = f"has no column {wanted}; it has {' '.join(frame.columns)}"
    return _no_dump(path, frame.step, message, hint)


def _no_dump(path: Path, step: int | None, message: str, hint: str = "") -> InputError:
    where = "dump" if step is None else f"frame of step {step}"
    hint = hint or "give a text dump: dump ID all custom N FILE id x y z ix iy iz"
    return InputError(str(path), [Problem(where, None, message, hint)])
