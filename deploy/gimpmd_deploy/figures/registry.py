"""The figures of a run, by name; a module of this package adds one by ``@run_figure``."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import gimpmd_deploy.figures
from gimpmd_deploy.results.run import Run

Draw = Callable[[Run, Path, bool], list[Path]]
"""Draws a run into a folder, at every output or at some of them; returns the files."""

FIGURES: dict[str, Draw] = {}
"""All figures of a run by name."""


def run_figure(name: str) -> Callable[[Draw], Draw]:
    """Register a function that draws one figure, or one figure over time, of every run.

    Parameters
    ----------
    name : str
        Name of the figure; the file is usually ``NAME.png``.
    """

    def register(draw: Draw) -> Draw:
        FIGURES[name] = draw
        return draw

    return register


def draw_all(run: Run, every: bool = False) -> list[Path]:
    """Draw all figures of a run into its ``figures/``.

    Parameters
    ----------
    every : draw fields at every output, instead of at most a dozen of them.

    Returns
    -------
    list of Path
        The files, in the order of the names of the figures.

    Raises
    ------
    BackendError
        Matplotlib is not installed.
    InputError
        The run wrote no output.
    """
    for module in pkgutil.iter_modules(gimpmd_deploy.figures.__path__):
        import_module(f"{gimpmd_deploy.figures.__name__}.{module.name}")
    folder = run.folder / "figures"
    folder.mkdir(exist_ok=True)
    return [path for _, draw in sorted(FIGURES.items()) for path in draw(run, folder, every)]
