"""LAMMPS text dumps, read frame by frame and written again with more columns."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain.box import Box

_POSITIONS = (
    (("xu", "yu", "zu"), False, True),
    (("xsu", "ysu", "zsu"), True, True),
    (("x", "y", "z"), False, False),
    (("xs", "ys", "zs"), True, False),
)
"""Names of position columns, best first; whether scaled by the box; whether unwrapped."""


@dataclass(frozen=True)
class Frame:
    """One frame of a dump, as text.

    Attributes
    ----------
    step : int
    low, high : ndarray, shape ``(3,)``
        Corners of the box, for a tilted one before the tilt.
    tilts : ndarray, shape ``(3,)``
        xy, xz, yz.
    periodic : ndarray of bool, shape ``(3,)``
    columns : list of str
    head : list of bytes
        The lines before the atoms, but for the last, which names the columns.
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
        """Columns as numbers, shape ``(atoms, len(names))``."""
        wanted = [self.columns.index(name) for name in names]
        text = io.BytesIO(b"".join(self.rows))
        return np.loadtxt(text, usecols=wanted, ndmin=2).reshape(len(self.rows), len(names))


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
    """The whole frames of a dump (``.gz`` too); a last one that was cut off is left out.

    Raises
    ------
    InputError
        The file is missing, or no text dump of LAMMPS.
    """
    try:
        with _opened(path) as file:
            read = None
            while (read := _frame(path, file)) is not None:
                yield read
    except (OSError, EOFError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise _no_dump(path, None, f"cannot be read: {reason}") from None


def atoms_of(path: Path, frame: Frame) -> Atoms:
    """Ids, positions and masses of a frame.

    Raises
    ------
    InputError
        A column is missing, a value is no number, or an id appears twice.
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
        raise _no_dump(path, frame.step, f"has a row that is no atom: {error}") from None
    ids = data[:, 0].astype(np.int64)
    x = data[:, 1:4]
    if not np.isfinite(x).all():
        raise _no_dump(path, frame.step, "has an atom that is nowhere (nan or inf)")
    if len(np.unique(ids)) != len(ids):
        raise _no_dump(path, frame.step, "names an atom twice")
    box = frame.box(3)
    if scaled:
        x = box.origin + x @ box.edges.T
    if images and not unwrapped:
        x = x + data[:, 4:7] @ box.edges.T
    m = data[:, -1] if mass else np.ones(len(ids))
    if not (m > 0.0).all():
        raise _no_dump(path, frame.step, "has an atom without mass")
    return Atoms(ids, x, m, unwrapped or bool(images))


def write_frame(file: IO[bytes], frame: Frame, names: Sequence[str], values: Floats) -> None:
    """Write a frame with more columns; ``values`` has shape ``(atoms, len(names))``."""
    file.writelines(frame.head)
    file.write(b"ITEM: ATOMS " + " ".join([*frame.columns, *names]).encode() + b"\n")
    template = b" %.9g" * len(names) + b"\n"
    file.writelines(
        row.rstrip() + template % tuple(value)
        for row, value in zip(frame.rows, values.tolist(), strict=True)
    )


def _opened(path: Path) -> IO[bytes]:
    with path.open("rb") as file:
        zipped = file.read(2) == b"\x1f\x8b"
    return gzip.open(path, "rb") if zipped else path.open("rb")  # type: ignore[return-value]


def _frame(path: Path, file: IO[bytes]) -> Frame | None:
    """The next frame, None at the end or if the rest is no whole frame."""
    head: list[bytes] = []
    step = count = None
    bounds: tuple[list[str], list[list[float]]] | None = None
    while line := file.readline():
        head.append(line)
        try:
            if line.startswith(b"ITEM: TIMESTEP"):
                head.append(file.readline())
                step = int(head[-1])
            elif line.startswith(b"ITEM: NUMBER OF ATOMS"):
                head.append(file.readline())
                count = int(head[-1])
            elif line.startswith(b"ITEM: BOX BOUNDS"):
                head += [file.readline() for _ in range(3)]
                words = line.decode().split()[3:]
                bounds = (words, [[float(word) for word in row.split()] for row in head[-3:]])
            elif line.startswith(b"ITEM: ATOMS"):
                break
            elif not line.startswith(b"ITEM:") and len(head) == 1:
                raise ValueError("it begins with no ITEM:")
        except ValueError as error:
            if head[-1].endswith(b"\n"):
                raise _no_dump(path, step, f"is no LAMMPS text dump: {error}") from None
            return None  # cut off within the number
    else:
        return None
    if step is None or count is None or bounds is None:
        raise _no_dump(path, step, "has atoms without step, number of atoms or box before them")
    rows = [row for row in (file.readline() for _ in range(count)) if row]
    if len(rows) < count or (rows and not rows[-1].endswith(b"\n")):
        return None
    low, high, tilts, periodic = _box(path, step, *bounds)
    columns = head.pop().decode().split()[2:]
    return Frame(step, low, high, tilts, periodic, columns, head, rows)


def _box(
    path: Path, step: int, words: list[str], rows: list[list[float]]
) -> tuple[Floats, Floats, Floats, Bools]:
    tilted = words[:3] == ["xy", "xz", "yz"]
    flags = words[3:] if tilted else words
    if {len(row) for row in rows} != {3 if tilted else 2} or len(flags) != 3:
        hint = "write it with dump_modify triclinic/general no"
        message = f"has a box that is not understood: {' '.join(words)}"
        raise _no_dump(path, step, message, hint)
    low, high = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    tilts = np.array([row[2] for row in rows]) if tilted else np.zeros(3)
    if tilted:  # the bounds are those of the tilted box
        xy, xz, yz = tilts
        low -= [min(0.0, xy, xz, xy + xz), min(0.0, yz), 0.0]
        high -= [max(0.0, xy, xz, xy + xz), max(0.0, yz), 0.0]
    if not (high > low).all():
        raise _no_dump(path, step, "has a box without volume")
    return low, high, tilts, np.array([flag == "pp" for flag in flags])


def _no_columns(path: Path, frame: Frame, wanted: str) -> InputError:
    hint = f"write it with dump ... custom N FILE {wanted} ..."
    message = f"has no column {wanted}; it has {' '.join(frame.columns)}"
    return _no_dump(path, frame.step, message, hint)


def _no_dump(path: Path, step: int | None, message: str, hint: str = "") -> InputError:
    where = "dump" if step is None else f"frame of step {step}"
    hint = hint or "give a text dump: dump ID all custom N FILE id x y z ix iy iz"
    return InputError(str(path), [Problem(where, None, message, hint)])
