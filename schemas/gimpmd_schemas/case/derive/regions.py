"""Boxes of atoms, and how MPI ranks divide them and the domain into patches."""

from __future__ import annotations

from collections.abc import Iterator

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.grid.zones import Box


def md_regions(case: Case) -> tuple[Box, ...]:
    """Boxes of atoms: the MD regions, or the whole domain in a run of MD only."""
    if case.only == "md":
        return (case.domain.box,)
    return tuple(case.atoms.boxes().values())


def md_region(case: Case) -> Box:
    """Box around all atoms, which patches divide."""
    return tuple(
        (min(low for low, _ in pairs), max(high for _, high in pairs))
        for pairs in zip(*md_regions(case), strict=True)
    )


def md_patches(case: Case) -> tuple[int, ...]:
    """Patches of the atoms along each axis; ``auto`` makes them as square as possible."""
    if case.atoms.patches == "auto":
        return squarest(md_region(case), case.atoms.ranks)
    return case.atoms.patches


def continuum_patches(case: Case) -> tuple[int, ...]:
    """Patches of the continuum along each axis; ``auto`` makes them as square as possible."""
    if case.continuum.patches == "auto":
        return squarest(case.domain.box, case.continuum.ranks)
    return case.continuum.patches


def squarest(box: Box, ranks: int) -> tuple[int, ...]:
    """Divide a box into ``ranks`` patches that are as square as possible.

    Returns
    -------
    tuple of int
        Number of patches along each axis.
    """
    small = [p for p in range(1, int(ranks**0.5) + 1) if ranks % p == 0]
    divisors = {*small, *(ranks // p for p in small)}

    def layouts(n: int, axes: int) -> Iterator[tuple[int, ...]]:
        if axes == 1:
            yield (n,)
            return
        for p in divisors:
            if n % p == 0:
                yield from ((p, *rest) for rest in layouts(n // p, axes - 1))

    def unevenness(counts: tuple[int, ...]) -> float:
        edges = [(hi - lo) / n for (lo, hi), n in zip(box, counts, strict=True)]
        return max(edges) - min(edges)

    return min(layouts(ranks, len(box)), key=lambda counts: (unevenness(counts), counts))
