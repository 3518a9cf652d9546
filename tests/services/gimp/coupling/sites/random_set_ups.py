"""Random set-ups of crystals in space: uniform strain, the correction, and the lowest modes.

    python -m tests.services.gimp.coupling.sites.random_set_ups [Cu Al Fe Si]

prints a line for each set-up, and the rows of the table in docs/scheme-fs.md. Most are *columns*:
the body repeats along one axis, so that they have few freedoms.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from gimpmd_gimp.coupling.sites.correction import check_moduli
from gimpmd_gimp.coupling.sites.modes import ROUND_OFF, SURFACE
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box
from tests.services.gimp.coupling.sites.crystals import BCC, FCC, turned
from tests.services.gimp.coupling.sites.interfaces import Setup, by_the_rule, silicon
from tests.services.gimp.coupling.sites.test_correction import worst, worst_without_traction

INF = np.inf

LARGEST_CELL, LONGEST = 8.2, 18.0
"""Cells, and lengths of columns, up to which set-ups are small enough (angstrom)."""

LEAST_CELL = {"Cu": 4.4, "Al": 4.8, "Fe": 4.2, "Si": 5.4}
"""Cells below which most corrections are too large (angstrom)."""

GAP = 11.0
"""Room for the ghosts of two regions (angstrom)."""

METALS = {
    "Cu": ("Cu_mishin1.eam.alloy", 3.615, FCC),
    "Al": ("NiAlH_jea.eam.alloy", 4.05, FCC),
    "Fe": ("Fe_mm.eam.fs", 2.8553, BCC),
}
"""Potential file of LAMMPS, lattice constant and lattice."""

AXES = {
    "{100}": np.eye(3),
    "{110}": np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "{111}": np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, -2.0]]),
}

REASONS = {
    "no plane midway": "no place for planes",
    "other moduli": "correction too large",
    "of the traction is left": "no balance",
    "no continuum near it can be corrected": "no balance",
    "almost no continuum": "gap too narrow",
}
"""Why set-ups are refused, by parts of the messages."""


class Kind(NamedTuple):
    """Set-ups of one kind: orientation, axis along which they repeat (None: box), and shape.

    Shapes are ``box``, ``L`` and ``pair`` inside the body, ``face``, where a box ends at a face of
    the body, and ``edge``, where it ends at two.
    """

    axes: str
    along: int | None
    shape: str
    count: int

    @property
    def at_face(self) -> bool:
        return self.shape in ("face", "edge")


OF_METALS = [
    Kind("{100}", 2, "box", 24),
    Kind("{100}", 2, "L", 18),
    Kind("{100}", 2, "pair", 10),
    Kind("{100}", 2, "face", 14),
    Kind("{100}", 2, "edge", 10),
    Kind("{110}", 2, "box", 10),
    Kind("{110}", 2, "L", 6),
    Kind("{110}", 0, "box", 8),
    Kind("{110}", 0, "L", 6),
    Kind("{110}", 2, "face", 3),
    Kind("{110}", 0, "face", 3),
    Kind("{111}", 0, "box", 6),
    Kind("{111}", 0, "L", 4),
    Kind("{111}", 2, "box", 6),
    Kind("{111}", 2, "L", 4),
    Kind("{100}", None, "box", 4),
]
OF_SILICON = [
    Kind("{100}", 2, "box", 90),
    Kind("{100}", 2, "L", 20),
    Kind("{100}", 2, "pair", 8),
    Kind("{100}", None, "box", 4),
    Kind("{110}", 2, "box", 10),
    Kind("{110}", 2, "L", 6),
    Kind("{110}", 0, "box", 8),
    Kind("{110}", 0, "L", 6),
]
KINDS = dict.fromkeys(METALS, OF_METALS) | {"Si": OF_SILICON}

Make = Callable[[np.ndarray, float, list[Box], dict[int, int]], Setup]
"""Makes a set-up of the offset of the crystal, the cell, wanted boxes, and cells along columns."""


class Outcome(NamedTuple):
    """Of one set-up: sizes, and what the tables say; ``refused`` is empty if it is not.

    Attributes
    ----------
    freedoms : of free atoms and nodes, three each.
    left : residual of uniform strain by the equations, over the traction on the face of a cell.
    written : the same by the energies as they are written; at faces, of strains without traction.
    at_faces : residual of strains that load a face.
    change : largest dA over C11.
    gradient : whether there is a gradient term.
    lowest : lowest eigenvalue over the largest.
    zeros : number of eigenvalues that are zero, less that of rigid motions.
    first : lowest eigenvalue above those of the rigid motions, over the largest.
    """

    refused: str
    freedoms: int = 0
    left: float = 0.0
    written: float = 0.0
    at_faces: float = 0.0
    change: float = 0.0
    gradient: bool = False
    lowest: float = 0.0
    zeros: int = 0
    first: float = 1.0


@contextmanager
def maker(name: str, axes: str, folder: Path) -> Iterator[tuple[Make, np.ndarray, np.ndarray]]:
    """How to make set-ups of a crystal; its period and the distance of its layers."""
    if name == "Si":
        with silicon(folder, AXES[axes]) as (make, crystal):
            yield make, crystal.period, crystal.layers
        return
    file, a, lattice = METALS[name]
    crystal = turned(file, name, a, lattice, AXES[axes])

    def make(offset: np.ndarray, h: float, boxes: list[Box], rounds: dict[int, int]) -> Setup:
        return by_the_rule(replace(crystal, offset=offset), h, boxes, rounds)

    yield make, crystal.period, crystal.layers


def draw(
    kind: Kind,
    make: Make,
    period: np.ndarray,
    layers: np.ndarray,
    least: float,
    rng: np.random.Generator,
) -> Setup:
    """A random set-up: its cell, where the planes cut their cells, and how wide it is."""
    h, rounds = _cell(kind.along, period, max(least, period.max()), rng)
    offset = rng.uniform(0.0, layers)
    offset[_faces(kind)] = 0.0
    boxes = [tuple(map(tuple, box.tolist())) for box in _boxes(kind, h, rng)]
    return make(offset, h, boxes, rounds)


def _cell(
    along: int | None, period: np.ndarray, least: float, rng: np.random.Generator
) -> tuple[float, dict[int, int]]:
    """A cell, and for columns how many of them are a period of the crystal or several long."""
    if along is None:
        return float(rng.uniform(least, LARGEST_CELL)), {}
    repeat = period[along]
    admitted = [
        (float(m * repeat / n), {along: n})
        for n, m in product((2, 3), range(1, int(LONGEST / repeat) + 1))
        if least - 1e-9 < m * repeat / n < LARGEST_CELL
    ]
    return admitted[rng.integers(len(admitted))]


def _across(kind: Kind) -> list[int]:
    """Axes along which there are planes."""
    return [axis for axis in range(3) if axis != kind.along]


def _faces(kind: Kind) -> list[int]:
    """Axes along which a box ends at a face of the body."""
    return _across(kind)[: {"face": 1, "edge": 2}.get(kind.shape, 0)]


def _boxes(kind: Kind, h: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Ends of wanted boxes along each axis."""
    start, width = rng.uniform(-1.0, 0.0, 3) * h, rng.uniform(0.8, 1.4, 3) * h + 1.0
    start[_faces(kind)] = 0.0
    ends = np.stack([start, start + width], axis=1)
    ends[_faces(kind), 0] = -INF
    if kind.along is not None:
        ends[kind.along] = -INF, INF
    first, second = _across(kind)[:2]
    if kind.shape == "L":
        wide, tall = ends.copy(), ends.copy()
        wide[first, 1], tall[second, 1] = ends[[first, second], 1] + rng.uniform(1.0, 1.6, 2) * h
        return [wide, tall]
    if kind.shape == "pair":
        other = ends.copy()
        other[first] += width[first] + GAP + rng.uniform(2.0, 4.0) * h
        other[second] += rng.uniform(-0.5, 0.5) * h
        return [ends, other]
    return [ends]


def outcome(kind: Kind, setup: Setup) -> Outcome:
    """What is measured of one set-up; see `Outcome`."""
    found = setup.correction
    check_moduli(found, setup.stiffness)
    rigid = 6 if kind.along is None else 4
    zero = SURFACE if kind.at_face else ROUND_OFF
    values = np.linalg.eigvalsh(setup.hessian())
    values /= values[-1]
    return Outcome(
        "",
        len(values),
        found.left,
        worst_without_traction(setup) if kind.at_face else worst(setup),
        found.at_faces,
        float(np.abs(found.dA).max() / setup.stiffness[0, 0]),
        found.gradient is not None,
        float(values[0]),
        int((values < zero).sum()) - rigid,
        float(values[rigid]),
    )


def outcomes(name: str, kind: Kind, folder: Path) -> Iterator[Outcome]:
    """Of all set-ups of a kind. Each has its own seed.

    Raises
    ------
    BackendError
        A set-up is refused for a reason that is not among `REASONS`.
    """
    own = list(KINDS).index(name), KINDS[name].index(kind)
    with maker(name, kind.axes, folder) as (make, period, layers):
        for number in range(kind.count):
            rng = np.random.default_rng([*own, number])
            try:
                yield outcome(kind, draw(kind, make, period, layers, LEAST_CELL[name], rng))
            except BackendError as error:
                yield Outcome(reason(error))


def reason(error: BackendError) -> str:
    """Why a set-up is refused; see `REASONS`."""
    for part, why in REASONS.items():
        if part in str(error):
            return why
    raise error


def group(name: str, kind: Kind) -> str:
    """First cells of the row of the table in docs/scheme-fs.md that a kind belongs to."""
    if kind.along is None:
        return f"{name} {kind.axes} | boxes"
    return f"{name} {kind.axes} | columns{' at faces of the body' * kind.at_face}"


def row(first: str, found: list[Outcome]) -> str:
    """Of the table."""
    ran = [each for each in found if not each.refused]
    why = Counter(each.refused for each in found if each.refused)
    cells = [
        first,
        str(len(ran)),
        ", ".join(f"{count} {refused}" for refused, count in why.items()) or "none",
    ]
    if ran:
        cells += [
            str(sum(each.gradient for each in ran)),
            f"{max(max(each.left, each.written) for each in ran):.0e}",
            f"{max(each.at_faces for each in ran):.0e}",
            f"{max(each.change for each in ran):.3f}",
            f"{min(each.lowest for each in ran):.0e}",
            f"{min(each.first for each in ran):.1e}",
        ]
    return "| " + " | ".join(cells) + " |"


def main(names: list[str]) -> None:
    """Print all set-ups of some crystals, then the rows of the table."""
    rows: dict[str, list[Outcome]] = {}
    for name in names or list(KINDS):
        for kind in KINDS[name]:
            found = rows.setdefault(group(name, kind), [])
            with TemporaryDirectory() as folder:
                start = time.process_time()
                for number, each in enumerate(outcomes(name, kind, Path(folder))):
                    took = time.process_time() - start
                    print(name, *kind[:3], number, *each, f"{took:.1f} s", flush=True)
                    found.append(each)
                    start = time.process_time()
    for first, found in rows.items():
        print(row(first, found))


if __name__ == "__main__":
    main(sys.argv[1:])
