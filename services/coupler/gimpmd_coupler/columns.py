"""Values that ranks report at different times, in arrays with a row for each step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gimpmd_schemas.wire.messages import Array

_ROOM = 64


class Columns:
    """Arrays with a row for each step and a column for each rank, which grow as ranks report.

    A value that nobody has put in is zero.

    Parameters
    ----------
    first : int
        Step of the first row.
    """

    def __init__(self, first: int) -> None:
        self._first, self._room = first, 0
        self._arrays: dict[str, Array] = {}

    def put(self, name: str, ranks: int, rank: int, steps: range, values: ArrayLike) -> None:
        """Put in what a rank reports.

        Parameters
        ----------
        name : str
            Name of the array.
        ranks : int
            Number of its columns.
        rank : int
            The column.
        steps : range
            Steps, none of them taken out.
        values : array_like, shape ``(len(steps),)`` or ``()``
        """
        start, stop = steps.start - self._first, steps.stop - self._first
        if stop > self._room:
            self._grow(max(_ROOM, 2 * stop))
        values = np.asarray(values)
        if name not in self._arrays:
            self._arrays[name] = np.zeros((self._room, ranks), values.dtype)
        self._arrays[name][start:stop, rank] = values

    def take(self, count: int) -> dict[str, Array]:
        """Take out the first steps, which must be complete.

        Returns
        -------
        dict of ndarray, shape ``(count, ranks)``
            By name.
        """
        taken = {name: array[:count] for name, array in self._arrays.items()}
        self._arrays = {name: array[count:] for name, array in self._arrays.items()}
        self._first, self._room = self._first + count, self._room - count
        return taken

    def _grow(self, room: int) -> None:
        """Make room for more steps. What has been taken out keeps the old memory."""
        more = room - self._room
        self._arrays = {
            name: np.concatenate([array, np.zeros((more, *array.shape[1:]), array.dtype)])
            for name, array in self._arrays.items()
        }
        self._room = room
