"""Rows of decimal numbers, read faster than numpy does: large dumps hold millions of them."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.compiled import njit

EXACT = 22
"""Powers of ten up to this one are exact floating-point numbers."""

DIGITS = 17
"""Numbers of more digits may not fit into an integer of 64 bits."""

_POWERS = 10.0 ** np.arange(EXACT + 1)
_TAB, _SPACE, _NEWLINE = 9, 32, 10
_PLUS, _MINUS, _POINT, _ZERO, _NINE = 43, 45, 46, 48, 57
_EXPONENT = (69, 101)


def rows_of_decimals(text: bytes, rows: int, wanted: Ints) -> Floats | None:
    """Read columns of a table of decimal numbers, separated by blanks, one row per line.

    A number of at most 15 digits whose power of ten is not beyond 22 is rounded correctly; others
    may differ from the nearest floating-point number by its last bit.

    Parameters
    ----------
    text : bytes
    rows : int
        Number of lines.
    wanted : ndarray of int64
        Columns to read, in the order of the result; a column may appear twice.

    Returns
    -------
    ndarray, shape ``(rows, len(wanted))``, or None
        None if a line lacks a wanted column, or if a word in one is not such a number (``nan``).
    """
    columns, order = np.unique(wanted, return_inverse=True)
    place = np.full(columns[-1] + 1, -1)
    place[columns] = np.arange(columns.size)
    found = np.empty((rows, columns.size))
    done = _read(np.frombuffer(text, np.uint8), place, _POWERS, found)
    return found[:, order] if done == rows else None


@njit(nogil=True, cache=True)
def _exponent(text: Ints, at: int, end: int) -> tuple[bool, np.int64 | int]:  # pragma: no cover
    """Read an exponent such as ``e-07``; say whether it is one."""
    if text[at] not in _EXPONENT:
        return False, 0
    at += 1
    negative = at < end and text[at] == _MINUS
    if negative or (at < end and text[at] == _PLUS):
        at += 1
    if not 0 < end - at <= 3:
        return False, 0
    power = np.int64(0)
    while at < end:
        if not _ZERO <= text[at] <= _NINE:
            return False, 0
        power = 10 * power + np.int64(text[at] - _ZERO)
        at += 1
    return True, -power if negative else power


@njit(nogil=True, cache=True)
def _number(
    text: Ints, at: int, end: int, powers: Floats
) -> tuple[bool, float]:  # pragma: no cover
    """Read the number in ``text[at:end]``; say whether it is one."""
    negative = text[at] == _MINUS
    if negative or text[at] == _PLUS:
        at += 1
    mantissa, digits, exponent, fraction = np.int64(0), 0, 0, False
    while at < end:
        c = text[at]
        if c == _POINT and not fraction:
            fraction = True
        elif _ZERO <= c <= _NINE:
            mantissa = 10 * mantissa + np.int64(c - _ZERO)
            digits += 1
            exponent -= fraction
        else:
            break
        at += 1
    if digits == 0 or digits > DIGITS:
        return False, 0.0
    if at < end:
        valid, power = _exponent(text, at, end)
        if not valid:
            return False, 0.0
        exponent += power
    value = np.float64(mantissa)
    while exponent > 0 and value != 0.0:
        step = min(exponent, EXACT)
        value *= powers[step]
        exponent -= step
    while exponent < 0 and value != 0.0:
        step = min(-exponent, EXACT)
        value /= powers[step]
        exponent += step
    return True, -value if negative else value


@njit(nogil=True, cache=True)
def _read(text: Ints, place: Ints, powers: Floats, out: Floats) -> int:  # pragma: no cover
    """Fill ``out``; return the number of complete rows before the first fault."""
    at, end = 0, text.size
    for row in range(out.shape[0]):
        for column in range(place.size):
            while at < end and (text[at] == _SPACE or text[at] == _TAB):
                at += 1
            start = at
            while at < end and text[at] > _SPACE:
                at += 1
            if at == start:
                return row
            if place[column] >= 0:
                valid, value = _number(text, start, at, powers)
                if not valid:
                    return row
                out[row, place[column]] = value
        while at < end and text[at] != _NEWLINE:
            at += 1
        at += 1
    return out.shape[0]
