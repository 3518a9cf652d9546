"""Colour scales of scalar fields: one for atoms and material points, with limits that last."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gimpmd_deploy.results.fields import Kind
from gimpmd_schemas.arrays import Floats

DIVERGING, SEQUENTIAL = "RdBu_r", "viridis"
"""Colour maps that colour-blind readers can use; the first is white in its middle."""

OUTLIERS = 1.0
"""Percentage of the values at each open end of a scale that lie beyond it."""


@dataclass(frozen=True)
class Scale:
    """A colour scale from ``low`` to ``high``."""

    low: float
    high: float
    cmap: str

    def colours(self) -> Any:
        """Return what maps values to colours."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        return ScalarMappable(Normalize(self.low, self.high), self.cmap)


def scale_of(values: Iterable[Floats], kind: Kind) -> Scale:
    """Choose a scale that ignores a few extreme values.

    Parameters
    ----------
    values : arrays of float
        Those of each side and time that the scale is for.
    kind : ``signed``, ``positive`` or ``any``
        ``signed``: zero is the middle; ``positive``: zero is the lower end.
    """
    each = [v[np.isfinite(v)] for v in values]
    each = [v for v in each if v.size]
    if kind == "signed":
        high = max((_upper(np.abs(v)) for v in each), default=0.0) or 1.0
        return Scale(-high, high, DIVERGING)
    high = max((_upper(v) for v in each), default=1.0)
    low = 0.0
    if kind == "any":
        low = min((float(np.percentile(v, OUTLIERS)) for v in each), default=0.0)
    return Scale(low, high if high > low else low + 1.0, SEQUENTIAL)


def given_scale(low: float, high: float, kind: Kind) -> Scale:
    """Return a scale with limits that the user chose."""
    return Scale(low, high, DIVERGING if kind == "signed" else SEQUENTIAL)


def _upper(values: Floats) -> float:
    """Upper end of a scale; the largest value if nearly all others are zero."""
    return float(np.percentile(values, 100.0 - OUTLIERS)) or float(values.max())
