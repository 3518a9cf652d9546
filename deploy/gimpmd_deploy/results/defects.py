"""Broken bonds near the planes over the time of a run: whether a defect reached the interface."""

from __future__ import annotations

from dataclasses import dataclass

import h5py
import numpy as np

from gimpmd_schemas.arrays import Floats, Ints


@dataclass(frozen=True)
class RunDefects:
    """Broken bonds between nearest neighbours near the planes, at all ``k`` coupling steps.

    Attributes
    ----------
    time : ndarray, shape ``(k,)``
    broken_bonds : ndarray of int, shape ``(k,)``
        Number of broken bonds.
    place : ndarray, shape ``(k, d)``
        Middle of the longest of them (length); NaN where there is none.
    """

    time: Floats
    broken_bonds: Ints
    place: Floats

    @classmethod
    def read(cls, series: h5py.Group) -> RunDefects | None:
        """Read ``series`` of ``run.h5``; None if the run watched no bonds."""
        if "md" not in series or "broken_bonds" not in series["md"]:
            return None
        md = series["md"]
        place = [md[f"broken_at_{x}"][:] for x in "xyz" if f"broken_at_{x}" in md]
        return cls(series["time"][:], md["broken_bonds"][:], np.stack(place, axis=1))

    def first(self) -> tuple[float, Floats] | None:
        """Time and place of the first broken bond; None if no bond broke."""
        steps = np.flatnonzero(self.broken_bonds)
        return (float(self.time[steps[0]]), self.place[steps[0]]) if steps.size else None
