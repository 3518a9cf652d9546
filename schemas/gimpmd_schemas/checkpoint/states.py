"""The states of the ranks of a role: one HDF5 file of arrays for each rank.

Arrays whose name begins with ``total/`` are amounts that add up over the ranks, such as work. Most
others belong to things that a rank holds, such as atoms or nodes, and have an array of their ids.
So a run can go on with another number of ranks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.manifest import (
    check_whole,
    committed,
    digest_of,
    folder_of,
    state_file,
)
from gimpmd_schemas.errors import BackendError, GimpmdError
from gimpmd_schemas.on_disk import sync

Array = np.ndarray[Any, np.dtype[Any]]
State = Mapping[str, Array]

TOTAL = "total/"


def save_state(run_dir: Path, step: int, role: Role, rank: int, state: State) -> str:
    """Write the state of a rank into the folder of a checkpoint, onto the disk.

    Returns
    -------
    str
        SHA-256 of the file, in hex.

    Raises
    ------
    OSError
        The disk is full, or the folder is gone.
    """
    folder = folder_of(run_dir, step)
    for made in (folder.parent, folder):  # a run folder that was deleted is not made again
        made.mkdir(exist_ok=True)
    path = folder / state_file(role, rank)
    with h5py.File(path, "w") as file:
        for name, array in state.items():
            file[name] = array
    sync(path)
    return digest_of(path)


@dataclass(frozen=True)
class SavedStates:
    """What the ranks of a role have saved, for a rank that goes on from there.

    Attributes
    ----------
    step : int
        The coupling step.
    paths : tuple of Path
        Files of the ranks that saved, in their order.
    rank, ranks : int
        Number of this rank, and the number of ranks now.
    """

    step: int
    paths: tuple[Path, ...]
    rank: int
    ranks: int

    @property
    def same_ranks(self) -> bool:
        """Whether the states were saved by as many ranks as there are now."""
        return len(self.paths) == self.ranks

    @cached_property
    def own(self) -> State:
        """The state of the rank with the number of this one."""
        return _read(self.paths[self.rank])

    @property
    def any(self) -> State:
        """The state of one of the ranks, for arrays that are the same on all."""
        return self.own if self.same_ranks else next(self.parts())

    def parts(self) -> Iterator[State]:
        """The states of all ranks that saved, one after another."""
        return map(_read, self.paths)

    def has(self, name: str) -> bool:
        """Whether the ranks have saved an array of this name."""
        with h5py.File(self.paths[0], "r") as file:
            return isinstance(file.get(name), h5py.Dataset)

    def arrays(self, name: str) -> list[Array]:
        """The array of this name of each rank that saved."""
        found = []
        for path in self.paths:
            with h5py.File(path, "r") as file:
                found.append(file[name][()])
        return found

    def total(self, name: str) -> Array:
        """Share of this rank in an amount: its own, or all of it on the first of other ranks."""
        amounts = self.arrays(TOTAL + name)
        if self.same_ranks:
            return amounts[self.rank]
        whole: Array = np.sum(amounts, axis=0)
        return whole if self.rank == 0 else np.zeros_like(whole)

    def shares(self) -> list[State]:
        """States that this rank takes over: its own, or all of them on the first of other ranks."""
        if self.same_ranks:
            return [self.own]
        return list(self.parts()) if self.rank == 0 else []

    def by_id(self, name: str, ids: str, wanted: Ints) -> Array:
        """Values of some things, whichever rank has saved them.

        Parameters
        ----------
        name : str
            Array of the values, shape ``(n, ...)``.
        ids : str
            Array of their ids, shape ``(n,)``.
        wanted : ndarray of int64, shape ``(m,)``
            Ids of the things.

        Raises
        ------
        BackendError
            No rank has saved one of them.
        """
        found: Array | None = None
        missing = np.ones(wanted.size, dtype=np.bool_)
        for known, values in zip(self.arrays(ids), self.arrays(name), strict=True):
            order = np.argsort(known)
            place = np.searchsorted(known[order], wanted).clip(max=max(known.size - 1, 0))
            here = known[order][place] == wanted if known.size else np.zeros_like(missing)
            if found is None:
                found = np.zeros((wanted.size, *values.shape[1:]), values.dtype)
            found[here] = values[order[place[here]]]
            missing &= ~here
        if found is None or missing.any():
            raise BackendError(
                f"the checkpoint of step {self.step} has no {name} for {int(missing.sum())} ids"
            )
        return found


def _read(path: Path) -> State:
    state: dict[str, Array] = {}

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            state[name] = item[()]

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return state


def saved_states(run_dir: Path, role: Role, rank: int, plan: Plan) -> SavedStates | None:
    """The states of the last checkpoint of a run; None if the run has no checkpoint.

    Raises
    ------
    GimpmdError
        A file is missing or damaged, or the checkpoint belongs to another plan.
    """
    found = committed(run_dir)
    if not found:
        return None
    last = found[0]
    if last.state != plan.state_digest():
        raise GimpmdError(
            f"{folder_of(run_dir, last.step)}: the checkpoint was made by another case; only the "
            "end of the run, its output and the number of ranks may change"
        )
    names = [state_file(role, number) for number in range(last.ranks[role])]
    paths = tuple(check_whole(run_dir, last, name) for name in names)
    return SavedStates(last.step, paths, rank, plan.ranks(role))
