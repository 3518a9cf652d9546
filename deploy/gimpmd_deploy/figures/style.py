"""Common style of all figures: colours, units in labels, and how a figure is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gimpmd_schemas.errors import BackendError, StorageError
from gimpmd_schemas.mechanics.units import UNITS

INK, SOFT, FAINT = "#222222", "#777777", "#E4E4E4"
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442", "#999999")
"""Colours of Okabe and Ito, which colour-blind readers can tell apart."""

DPI, FILM_DPI = 200, 120
"""Pixels per inch of figures and of films."""

Axes = Any
Figure = Any


def pyplot() -> Any:
    """Return pyplot with the common style.

    Raises
    ------
    BackendError
        Matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError:
        raise BackendError("figures need matplotlib: pip install 'gimpmd[viz]'") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update(
        {
            "font.size": 10,
            "axes.edgecolor": SOFT,
            "axes.labelcolor": INK,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "xtick.color": SOFT,
            "ytick.color": SOFT,
            "legend.frameon": False,
            "figure.constrained_layout.use": True,
            "axes.formatter.use_mathtext": True,
            "figure.dpi": DPI,
        }
    )
    return plt


def save(figure: Figure, path: Path) -> Path:
    """Write a figure to a file and close it.

    Raises
    ------
    StorageError
        The file cannot be written; no part of it is left.
    """
    try:
        figure.savefig(path)
    except OSError as error:
        path.unlink(missing_ok=True)
        reason = error.strerror or str(error)
        raise StorageError(f"{path} cannot be written: {reason}") from None
    finally:
        pyplot().close(figure)
    return path


def unit_label(style: str, quantity: str, dim: int = 2) -> str:
    """Return the unit of a quantity as a label writes it.

    Parameters
    ----------
    style : unit style of the case
    quantity : ``length``, ``time``, ``energy``, ``pressure``, ``velocity``, ``energy_density`` or
        ``temperature``
    dim : number of dimensions
    """
    units = UNITS[style]
    derived = {
        "velocity": f"{units.length}/{units.time}",
        "energy_density": f"{units.energy}/{units.length}^d",
        "temperature": "epsilon/k_B" if style == "lj" else "K",
    }
    unit = str(derived.get(quantity) or getattr(units, quantity)).replace("^d", f"$^{dim}$")
    unit = unit.replace("k_B", "$k_B$")
    for name in ("sigma", "tau", "epsilon"):
        unit = unit.replace(name, f"$\\{name}$")
    return unit
