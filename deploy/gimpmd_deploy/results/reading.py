"""Reading what a run left: material points, atoms, and the time series of ``run.h5``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import h5py
import numpy as np
from scipy.spatial import Delaunay, cKDTree

from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain import dump

ROLES = ("md", "continuum")

T = TypeVar("T")


@dataclass(frozen=True)
class Particles:
    """Atoms or material points at one time; ``n`` rows each, in the order of their ids.

    Attributes
    ----------
    site : ndarray, shape ``(n, 2)``
        What names a particle in every run: lattice position or reference position.
    x, displacement : ndarray, shape ``(n, 2)``
        Position, and displacement from the (relaxed) reference state.
    stress : ndarray, shape ``(n, 3)``
        xx, yy, xy in pressure units.
    size : ndarray, shape ``(n, 2)``
        Full extents; of atoms the distance of neighbours.
    """

    time: float
    site: Floats
    x: Floats
    displacement: Floats
    stress: Floats
    size: Floats

    def where(self, mask: Bools) -> Particles:
        """The particles for which ``mask`` holds."""
        arrays = (self.site, self.x, self.displacement, self.stress, self.size)
        return Particles(self.time, *(array[mask] for array in arrays))


class PointsFile:
    """Material points over time (``fields/points.vtkhdf``)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with h5py.File(path) as file:
            self.times: list[float] = file["VTKHDF/Steps/Values"][:].tolist()
            steps = file["VTKHDF/Steps"]
            counts = file["VTKHDF/NumberOfPoints"][:]
            self.counts: list[int] = counts[steps["PartOffsets"][:]].tolist()

    def read(self, index: int) -> Particles:
        """Points at one output."""
        with h5py.File(self.path) as file:
            root = file["VTKHDF"]
            start = int(root["Steps/PointOffsets"][index])
            rows = slice(start, start + self.counts[index])
            x = root["Points"][rows, :2].astype(np.float64)
            displacement = root["PointData/displacement"][rows, :2].astype(np.float64)
            stress = root["PointData/stress"][rows, :3].astype(np.float64)
            size = root["PointData/size"][rows, :2].astype(np.float64)
        return Particles(self.times[index], x - displacement, x, displacement, stress, size)


class AtomsFile:
    """Atoms over time (``atoms/atoms.dump``, a text dump of LAMMPS).

    Attributes
    ----------
    frames : list of FrameIndex
        The complete frames.
    times : list of float
        Their times.
    """

    def __init__(self, path: Path, timestep: float) -> None:
        self.path = path
        self.frames = dump.index(path)
        self.times = [frame.step * timestep for frame in self.frames]

    @cached_property
    def lattice(self) -> tuple[float, float]:
        """Distance of neighbouring atoms, and area per atom, of the crystal."""
        return lattice_of(self.columns(0, ("X0", "Y0")))

    def read(self, index: int) -> Particles:
        """Atoms at one output."""
        names = ("X0", "Y0", "x", "y", "ux", "uy", "sxx_area", "syy_area", "sxy_area")
        data = self.columns(index, names)
        spacing, area = self.lattice
        return Particles(
            time=self.times[index],
            site=data[:, 0:2],
            x=data[:, 2:4],
            displacement=data[:, 4:6],
            stress=data[:, 6:9] / area,
            size=np.full((data.shape[0], 2), spacing),
        )

    def columns(self, index: int, names: tuple[str, ...]) -> Floats:
        """Columns of one frame, one row for each atom in the order of their ids.

        Raises
        ------
        InputError
            The dump lacks a column, or the frame cannot be read.
        """
        place = self.frames[index]
        missing = [name for name in ("id", *names) if name not in place.columns]
        if missing:
            message = f"has no column {missing[0]}"
            hint = "run the case again, so that the MD service of this version writes the dump"
            raise InputError(str(self.path), [Problem("ITEM: ATOMS", None, message, hint)])
        data = dump.read_frame(self.path, place).numbers(("id", *names))
        return data[np.argsort(data[:, 0])][:, 1:]


SAMPLE = 4000
"""Atoms from which the lattice is measured: those nearest to the middle."""


def lattice_of(site: Floats) -> tuple[float, float]:
    """Distance of neighbours, and area per atom, of a crystal.

    A triangulation of a plane lattice has two equal triangles for every site; medians pass over
    cracks and edges.
    """
    if len(site) < 3:
        return 1.0, 1.0
    sample = site[np.argsort(((site - site.mean(axis=0)) ** 2).sum(axis=1))[:SAMPLE]]
    spacing = float(np.median(cKDTree(sample).query(sample, k=2)[0][:, 1]))
    corners = sample[Delaunay(sample).simplices]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return spacing, float(np.median(np.abs(ax * by - ay * bx)))


@dataclass(frozen=True)
class Series:
    """What ``run.h5`` records, one value per coupling step.

    Where the levels of the grid stood at different times, values are interpolated.

    Attributes
    ----------
    time : ndarray, shape ``(k,)``
    sides : by role and quantity (``kinetic``, ``potential``, ``external_work``, ``mass``, ...).
    energy, work, heat : of all sides; heat is what they dissipated on purpose.
    timings : wall seconds by role and phase, each the mean over the ranks of the role.
    busy : wall seconds of every process but for waiting, by ``role/rank``.
    memory : largest resident set of every process (bytes), by ``role/rank``.
    seconds : wall time from start to end, None while the run goes on.
    outcome : ``completed``, ``stopped``, ``running``, or who was lost or failed.
    """

    time: Floats
    sides: dict[str, dict[str, Floats]]
    energy: Floats
    work: Floats
    heat: Floats
    timings: dict[str, dict[str, Floats]]
    busy: dict[str, float]
    memory: dict[str, int]
    seconds: float | None
    outcome: str

    @classmethod
    def read(cls, path: Path) -> Series:
        """Read the record of a run."""
        with h5py.File(path, locking=False) as file:
            series, timings = file["series"], file.get("timings", {})
            roles = [name for name in ROLES if name in series]
            time = series["time"][:]
            return cls(
                time=time,
                sides={
                    role: {name: _between(time, data[:]) for name, data in series[role].items()}
                    for role in roles
                },
                energy=_between(time, series["total/energy"][:]),
                work=_between(time, series["total/external_work"][:]),
                heat=_between(time, series["total/dissipated"][:]),
                timings={role: _mean_over_ranks(timings[role]) for role in roles},
                busy={
                    f"{role}/{rank}": _total(phases) - _total(phases, "wait")
                    for role in roles
                    for rank, phases in timings[role].items()
                },
                memory={
                    f"{role}/{rank}": int(data[:].max(initial=0))
                    for role, ranks in file.get("memory", {}).items()
                    for rank, data in ranks.items()
                },
                seconds=_seconds(file.attrs),
                outcome=str(file.attrs["outcome"]),
            )

    def missing(self) -> Floats:
        """Energy that went missing since the start, ``W - D - (E - E0)``, at every step."""
        return self.work - self.work[:1] - self.heat - (self.energy - self.energy[:1])

    def taken(self) -> Floats:
        """Energy that the interface took from both sides together, at every step.

        Minus the sum of their interface work: in the velocity schemes waves and heat that the grid
        cannot carry; nothing in the force scheme, whose sides do opposite work.
        """
        work = np.sum([side["interface_work"] for side in self.sides.values()], axis=0)
        return np.asarray(work[:1] - work)

    def scale(self) -> float:
        """Largest work done, or the energy at the start: what missing energy is measured by."""
        return max(float(np.abs(self.work).max(initial=0.0)), *np.abs(self.energy[:1]), 0.0)

    def balance(self) -> float:
        """Largest missing energy, relative to the scale."""
        scale = self.scale()
        return float(np.abs(self.missing()).max()) / scale if scale > 0.0 else 0.0

    def unexplained(self) -> float:
        """Missing energy at the end that the interface did not take either, over the scale.

        Forces at the ends of windows stand for those between: a few per cent of the heat.
        """
        scale = self.scale()
        return float((self.missing() - self.taken())[-1]) / scale if scale > 0.0 else 0.0


def _between(time: Floats, values: Floats) -> Floats:
    """Values with gaps (NaN) filled linearly in time."""
    known = np.isfinite(values)
    return np.interp(time, time[known], values[known]) if known.any() else values


def _mean_over_ranks(ranks: h5py.Group) -> dict[str, Floats]:
    phases = dict.fromkeys(phase for rank in ranks.values() for phase in rank)
    return {
        phase: np.mean([rank[phase][:] for rank in ranks.values() if phase in rank], axis=0)
        for phase in phases
    }


def _total(phases: h5py.Group, *names: str) -> float:
    """Wall seconds of some phases, or of all."""
    chosen = [name for name in phases if not names or name in names]
    return float(sum(phases[name][:].sum() for name in chosen))


def _seconds(attributes: Mapping[str, str]) -> float | None:
    if "end" not in attributes:
        return None
    start, end = (datetime.fromisoformat(attributes[name]) for name in ("start", "end"))
    return (end - start).total_seconds()


def find_time(times: Sequence[float], time: float, near: float) -> int | None:
    """Index of the entry nearest to ``time``, if it is nearer than ``near``."""
    if not times:
        return None
    index = int(np.argmin(np.abs(np.asarray(times) - time)))
    return index if abs(times[index] - time) < near else None


def _opened(path: Path, opener: Callable[[], T]) -> T:
    try:
        return opener()
    except (OSError, KeyError, ValueError) as error:
        hint = "run the case again"
        raise InputError(str(path), [Problem("file", None, f"is damaged: {error}", hint)]) from None


class Run:
    """A run folder: its case and whatever it wrote."""

    def __init__(self, folder: Path) -> None:
        """Open a run folder.

        Raises
        ------
        InputError
            The folder holds no run.
        """
        self.folder = folder
        if not (folder / "case.yaml").is_file():
            hint = "give the folder that gimpmd run made, for example runs/mode1-small"
            raise InputError(str(folder), [Problem("case.yaml", None, "is no run folder", hint)])
        self.case: Case = load_case(folder / "case.yaml")

    @cached_property
    def series(self) -> Series:
        """The time series of ``run.h5``.

        Raises
        ------
        InputError
            There is none, or it is damaged.
        """
        path = self.folder / "run.h5"
        return _opened(path, lambda: Series.read(path))

    @cached_property
    def points(self) -> PointsFile | None:
        """Material points, if the continuum took part."""
        path = self.folder / "fields" / "points.vtkhdf"
        return _opened(path, lambda: PointsFile(path)) if path.is_file() else None

    @cached_property
    def atoms(self) -> AtomsFile | None:
        """Atoms, if the MD took part."""
        path = self.folder / "atoms" / "atoms.dump"
        if not path.is_file():
            return None
        return _opened(path, lambda: AtomsFile(path, self.case.md_timestep()))

    def times(self) -> list[float]:
        """Times at which everything that took part was written."""
        files = [file for file in (self.points, self.atoms) if file is not None]
        if not files:
            hint = "see the folder's logs/"
            raise InputError(str(self.folder), [Problem("fields", None, "wrote no output", hint)])
        near = 0.5 * self.case.step()
        return [
            time
            for time in files[0].times
            if all(find_time(file.times, time, near) is not None for file in files[1:])
        ]

    def points_at(self, time: float) -> Particles | None:
        """Material points at the output nearest to ``time``, if within half a step."""
        return self._at(self.points, time)

    def atoms_at(self, time: float) -> Particles | None:
        """Atoms at the output nearest to ``time``, if within half a step."""
        return self._at(self.atoms, time)

    def _at(self, file: PointsFile | AtomsFile | None, time: float) -> Particles | None:
        if file is None:
            return None
        index = find_time(file.times, time, 0.5 * self.case.step())
        return None if index is None else file.read(index)
