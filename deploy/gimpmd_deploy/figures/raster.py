"""Images of particles that are smaller than a few pixels: each pixel shows their mean."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.compiled import njit


def mean_image(low: Floats, high: Floats, values: Floats, shape: tuple[int, int]) -> Floats:
    """Average the values of rectangles in the pixels that they cover.

    A rectangle covers the pixels whose centres it contains, or the pixel about its own centre if it
    contains none. So particles without gaps between them give an image without holes, and a
    particle much smaller than a pixel counts in one pixel.

    Parameters
    ----------
    low, high : ndarray, shape ``(n, 2)``
        Corners of the rectangles in pixels from the lower left corner of the image, along x and y.
    values : ndarray, shape ``(n,)``
    shape : numbers of pixels along y and x

    Returns
    -------
    ndarray of that shape
        NaN in pixels that nothing covers.
    """
    sums, counts = np.zeros(shape), np.zeros(shape)
    _add(low, high, values, sums, counts)
    return np.divide(sums, counts, out=np.full(shape, np.nan), where=counts > 0.0)


@njit(nogil=True, cache=True)
def _add(
    low: Floats, high: Floats, values: Floats, sums: Floats, counts: Floats
) -> None:  # pragma: no cover
    rows, columns = sums.shape
    for k in range(values.size):
        first_x, last_x = _pixels(low[k, 0], high[k, 0])
        first_y, last_y = _pixels(low[k, 1], high[k, 1])
        for y in range(max(first_y, 0), min(last_y, rows)):
            for x in range(max(first_x, 0), min(last_x, columns)):
                sums[y, x] += values[k]
                counts[y, x] += 1.0


@njit(nogil=True, cache=True)
def _pixels(low: float, high: float) -> tuple[int, int]:  # pragma: no cover
    """First and past the last of the pixels whose centres lie between two points."""
    first, last = int(np.ceil(low - 0.5)), int(np.ceil(high - 0.5))
    if last > first:
        return first, last
    middle = int(np.floor(0.5 * (low + high)))
    return middle, middle + 1
