"""Numbers and units in words: how messages, tables and labels write them."""

from __future__ import annotations

from gimpmd_schemas.mechanics.units import Units


def quantity(value: float) -> str:
    """Write a large number with its SI prefix: ``1.2 M``."""
    for size, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:.3g} {prefix}"
    return f"{value:.3g}"


def clock(seconds: float) -> str:
    """Write seconds as ``h:mm:ss``, ``m:ss`` or ``s``."""
    if seconds < 59.5:
        return f"{seconds:.2g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def momentum_unit(units: Units) -> str:
    """Write the unit of momentum of a unit style."""
    return f"{units.mass} {units.length}/{units.time}"
