"""Strain of the atoms of a LAMMPS dump, on the ranks of an MPI program.

Rank 0 reads and writes. The atoms are divided among the ranks in the order of their ids, so that a
rank keeps its atoms from frame to frame. Nodal sums are added over all ranks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError, GimpmdError, InputError, Problem
from gimpmd_schemas.wire.answers import StrainSummary
from gimpmd_strain.background import increment_gradient, total_gradient
from gimpmd_strain.box import Configuration, unwrapped
from gimpmd_strain.dump import Frame, atoms_of, frames, write_frame
from gimpmd_strain.measures import COMPONENTS, MEASURES, components, infinitesimal
from gimpmd_strain.settings import Settings
from gimpmd_strain.virial import find_neighbours, nearest_distance, virial_strain

log = logging.getLogger(__name__)

T = TypeVar("T")
Strain = Callable[[Configuration], Floats]


@dataclass(frozen=True)
class _Reference:
    """The undeformed state, with atoms in the order of their ids, and the complete settings."""

    step: int
    all_: Configuration
    ids: Ints
    m: Floats
    unwrapped: bool
    distance: float
    settings: Settings


def strain_of_dump(
    dump: Path,
    out: Path,
    settings: Settings,
    comm: Any,
    reference: str = "first",
    dimension: int | None = None,
) -> StrainSummary:
    """Copy a dump and add the strain of every atom in new columns ``strain_xx`` and so on.

    Parameters
    ----------
    dump, out : Path
        Text dumps of LAMMPS; ``out`` appears when it is complete.
    settings : Settings
    comm : mpi4py communicator
        Its ranks share the work; all of them call this function.
    reference : str
        The undeformed state: ``first`` for the first frame, a step of the dump (earlier frames are
        left out), or the path of another dump, of which the first frame is taken.
    dimension : int, optional
        2 or 3. By default it is 2 if the reference has no extent in z, and 3 otherwise.

    Raises
    ------
    GimpmdError
        Raised on every rank: the dump, the reference or a setting cannot be used.
    """
    start = _on_root(comm, lambda: _reference(dump, out, settings, reference, dimension))
    strain = _method(start.settings, start.all_, start.m, comm)
    d = start.all_.x.shape[1]
    names = [f"strain_{name}" for name in COMPONENTS[d]]
    partial = out.with_name(out.name + ".part")
    sequence = _sequence(dump, start, reference)
    current: tuple[Frame, Configuration, Ints] | None = None

    def advance() -> Configuration | None:
        nonlocal current
        current = next(sequence, None)
        return None if current is None else current[1]

    written = undefined = 0
    try:
        while (now := _on_root(comm, advance)) is not None:
            parts = comm.gather(components(strain(now)))
            if current is not None:  # on rank 0
                frame, _, row = current
                values = np.concatenate(parts)[row]
                undefined = int(np.isnan(values).any(axis=1).sum())
                with partial.open("ab" if written else "wb") as file:
                    write_frame(file, frame, names, values)
                written += 1
        if comm.rank == 0:
            partial.replace(out)
    finally:
        if comm.rank == 0:
            partial.unlink(missing_ok=True)
    on_grid = settings.method != "virial"
    return StrainSummary(
        method=settings.method,
        columns=names,
        atoms=len(start.ids),
        frames=written,
        dimension=d,
        reference=start.step,
        distance=start.distance,
        cell=start.settings.cell if on_grid else None,
        cutoff=None if on_grid else start.settings.cutoff,
        undefined=undefined,
    )


def _method(settings: Settings, reference: Configuration, m: Floats, comm: Any) -> Strain:
    """Return a function that gives the strain of this rank's atoms, called frame by frame."""
    first, last = (len(m) * r // comm.size for r in (comm.rank, comm.rank + 1))

    def own(all_: Configuration) -> Configuration:
        return Configuration(all_.box, all_.x[first:last])

    if settings.method == "virial":
        assert settings.cutoff is not None
        neighbours = find_neighbours(own(reference).x, reference, settings.cutoff)
        return lambda now: virial_strain(neighbours, own(now).x, now)
    options, m, rest = settings.grid(), m[first:last], own(reference)
    if settings.method == "total":
        tensor = MEASURES[settings.measure]
        return lambda now: tensor(total_gradient(rest, own(now), m, options, comm))

    before, sum_ = rest, np.zeros((*rest.x.shape, rest.x.shape[1]))

    def incremental(now: Configuration) -> Floats:
        nonlocal before, sum_
        sum_ = sum_ + infinitesimal(increment_gradient(before, own(now), m, options, comm))
        before = own(now)
        return sum_

    return incremental


def _reference(
    dump: Path, out: Path, settings: Settings, choice: str, dimension: int | None
) -> _Reference:
    if not out.parent.is_dir():
        hint = "make this folder, or choose another place"
        raise InputError(str(out), [Problem("out", None, f"{out.parent} is not a folder", hint)])
    if out.exists() and dump.exists() and out.samefile(dump):
        hint = "give another file"
        raise InputError(str(out), [Problem("out", None, "is the dump itself", hint)])
    path, frame = _chosen(dump, choice)
    atoms = atoms_of(path, frame)
    order = np.argsort(atoms.ids)
    x = atoms.x[order]
    if dimension is None:
        dimension = 2 if len(x) and np.ptp(x[:, 2]) == 0.0 else 3
    all_ = Configuration(frame.box(dimension), np.ascontiguousarray(x[:, :dimension]))
    distance = nearest_distance(all_)
    return _Reference(
        step=frame.step,
        all_=all_,
        ids=atoms.ids[order],
        m=atoms.m[order],
        unwrapped=atoms.unwrapped,
        distance=distance,
        settings=settings.resolved(distance),
    )


def _chosen(dump: Path, choice: str) -> tuple[Path, Frame]:
    """Return the file and the frame of the reference."""
    is_step = choice.removeprefix("-").isdigit()
    path = dump if choice == "first" or is_step else Path(choice)
    steps = []
    for frame in frames(path):
        if not is_step or frame.step == int(choice):
            return path, frame
        steps.append(frame.step)
    if not is_step:
        hint = "let the run write at least one frame"
        raise InputError(str(path), [Problem("dump", None, "holds no complete frame", hint)])
    known = f"it has {len(steps)}, from {steps[0]} to {steps[-1]}" if steps else "it has none"
    hint = f"{known}; give one of them, or another dump"
    raise InputError(str(dump), [Problem("reference", int(choice), "is not a step of it", hint)])


def _sequence(
    dump: Path, start: _Reference, choice: str
) -> Iterator[tuple[Frame, Configuration, Ints]]:
    """Frames from the reference on, their atoms by id, and the place of each row of the dump."""
    last, d = start.all_, start.all_.x.shape[1]
    waiting = choice.removeprefix("-").isdigit()
    for frame in frames(dump):
        waiting = waiting and frame.step != start.step
        if waiting:
            continue
        atoms = atoms_of(dump, frame)
        order = np.argsort(atoms.ids)
        _check_same(dump, frame, atoms.ids[order], start)
        taken = sorted({f"strain_{name}" for name in COMPONENTS[d]} & set(frame.columns))
        if taken:
            message = f"has a column {taken[0]} already"
            hint = "give a dump without strains"
            raise InputError(
                str(dump), [Problem(f"frame of step {frame.step}", None, message, hint)]
            )
        box = frame.box(d).continued(last.box)
        x = np.ascontiguousarray(atoms.x[order, :d])
        if not (atoms.unwrapped and start.unwrapped):
            x = unwrapped(x, box, last)
        last = Configuration(box, x)
        row = np.empty_like(order)
        row[order] = np.arange(len(order))
        yield frame, last, row


def _check_same(dump: Path, frame: Frame, ids: Ints, start: _Reference) -> None:
    if np.array_equal(ids, start.ids):
        return
    odd = np.setxor1d(ids, start.ids)
    where = "is missing" if odd[0] in start.ids else "is not in the reference"
    message = f"has {len(ids)} atoms, the reference {len(start.ids)}; atom {odd[0]} {where}"
    hint = "dump a group that neither loses nor gains atoms, or choose a later reference"
    raise InputError(str(dump), [Problem(f"frame of step {frame.step}", None, message, hint)])


def _on_root(comm: Any, work: Callable[[], T]) -> T:
    """Do work on rank 0; all ranks get its result, or all raise its error."""
    result: Any = None
    error: GimpmdError | None = None
    if comm.rank == 0:
        try:
            result = work()
        except GimpmdError as failed:
            error = failed
    message = comm.bcast(error and str(error))
    if error is not None:
        raise error
    if message is not None:
        raise BackendError(message)
    return comm.bcast(result) if comm.size > 1 else result
