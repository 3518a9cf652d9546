"""Crystals with free or periodic faces, and their lattice."""

from __future__ import annotations

from itertools import product

import numpy as np

from gimpmd_strain.box import Box, Configuration

HEX = 3.0**0.5
CELLS = {
    "hex": ((1.0, HEX), ((0.0, 0.0), (0.5, 0.5))),
    "sc": ((1.0,) * 3, ((0.0, 0.0, 0.0),)),
    "bcc": ((1.0,) * 3, ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5))),
    "fcc": ((1.0,) * 3, ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5))),
}
"""Edges of the cell and its atoms, in units of the edges."""


def crystal(lattice: str, repeats: tuple[int, ...], periodic: bool) -> Configuration:
    """A block of whole cells, in a box that it fills."""
    edges, basis = (np.array(part) for part in CELLS[lattice])
    places = np.array(list(product(*(range(n) for n in repeats))), float)
    x = (places[:, None, :] + basis[None]).reshape(-1, len(edges)) * edges
    d = len(edges)
    box = Box(np.zeros(d) - 0.1, np.diag(edges * repeats), np.full(d, periodic))
    return Configuration(box, x)


def deformed(all_: Configuration, gradient: np.ndarray) -> Configuration:
    """The configuration after ``x = X + H X``, box and atoms."""
    F = np.eye(len(gradient)) + gradient
    box = all_.box
    return Configuration(Box(F @ box.origin, F @ box.edges, box.periodic), all_.x @ F.T)


def inside(all_: Configuration, depth: float, axes: int = 3) -> np.ndarray:
    """Atoms deeper than ``depth`` below the free faces of the first axes."""
    x = all_.x[:, :axes]
    return ((x > x.min(axis=0) + depth) & (x < x.max(axis=0) - depth)).all(axis=1)
