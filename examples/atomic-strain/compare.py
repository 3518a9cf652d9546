"""Atomic strain of a plate in tension and in shear, compared with finite elements.

``python compare.py`` runs everything, prints a table, and draws figures into ``figures/`` of the
current folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import elasticity
import matplotlib
import numpy as np
from mpi4py import MPI
from plate import END, EVERY, INNER, METHODS, STEP, SURFACE, Histories, sites
from plate import run as run_atoms

from gimpmd_strain.background import total_gradient
from gimpmd_strain.box import Box, Configuration
from gimpmd_strain.measures import components, infinitesimal

matplotlib.use("Agg")
from matplotlib import pyplot

SPEEDS = (0.1, 0.02)
TESTS = {"tension": 0, "shear": 2}
"""The tests, and the strain component that each drives: xx or xy."""

RUNNING_MEAN = 0.6
XX, YY, XY = range(3)


def rms(signal: np.ndarray) -> np.ndarray:
    """Root mean square over time."""
    return np.sqrt((signal**2).mean(axis=0))


def high_frequency(signal: np.ndarray) -> float:
    """RMS of the signal minus its running mean over 0.6, without the ends."""
    width = round(RUNNING_MEAN / (EVERY * STEP)) | 1
    mean = np.convolve(signal, np.full(width, 1.0 / width), "valid")
    half = width // 2
    return float(rms(signal[half:-half] - mean))


def rise_time(time: np.ndarray, signal: np.ndarray, plateau: float) -> float:
    """First time at which the signal reaches half the plateau, interpolated between outputs."""
    k = int(np.argmax(signal > 0.5 * plateau))
    part = (0.5 * plateau - signal[k - 1]) / (signal[k] - signal[k - 1])
    return float(time[k - 1] + part * (time[k] - time[k - 1]))


def numbers(test: str, speed: float, atoms: Histories, reference: np.ndarray) -> dict[str, dict]:
    """Errors, noise and rise time of each method in one test."""
    main = TESTS[test]
    wave = {"tension": elasticity.SPEED_P, "shear": (elasticity.SHEAR / elasticity.DENSITY) ** 0.5}
    plateau = speed / wave[test] * (1.0 if test == "tension" else 0.5)
    inner, surface = reference[:, 0], reference[:, 1]
    noise = high_frequency(atoms.strain["virial"][:, 0, main])
    found = {}
    for name in METHODS:
        strain = atoms.strain[name]
        found[name] = {
            "rms": float(rms(strain[:, 0, main] - inner[:, main]) / rms(inner[:, main])),
            "high frequency": high_frequency(strain[:, 0, main]) / noise,
            "rise": rise_time(atoms.time, strain[:, 0, main], plateau),
            **surface_errors(strain[:, 1], surface),
        }
    found["finite elements"] = {"rise": rise_time(atoms.time, inner[:, main], plateau)}
    return found


def fed(strain: np.ndarray, moved: np.ndarray) -> dict[str, dict]:
    """Surface errors of the weights: the atoms get the displacements of the finite elements."""
    X = sites()
    box = Box(np.zeros(2), np.diag(X.max(axis=0)), np.zeros(2, bool))
    own = [int(np.argmin(((X - place) ** 2).sum(axis=1))) for place in (INNER, SURFACE)]
    found = {}
    for name, settings in METHODS.items():
        if settings.method == "virial":
            continue
        seen = []
        for u in moved:
            H = total_gradient(
                Configuration(box, X),
                Configuration(box, X + u),
                np.ones(len(X)),
                settings.grid(),
                MPI.COMM_SELF,
            )
            seen.append(components(infinitesimal(H))[own])
        found[name] = surface_errors(np.array(seen)[:, 1], strain[:, 1])
    return found


def surface_errors(strain: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """RMS errors: of xx and yy relative to the RMS of their references, of xy relative to xx."""
    error, scale = rms(strain - reference), rms(reference)
    return {
        "surface xx": float(error[XX] / scale[XX]),
        "surface yy": float(error[YY] / scale[YY]),
        "surface xy": float(error[XY] / scale[XX]),
    }


def compute(speeds: tuple[float, ...] = SPEEDS) -> tuple[dict, dict, dict]:
    """Run all tests: histories of the atoms, references, and numbers, by test and speed."""
    histories, references, found = {}, {}, {}
    for test in TESTS:
        unit, moved = elasticity.run(test, 1.0)  # linear: one run serves all speeds
        found[test, "fed by elements"] = fed(unit, moved)
        for speed in speeds:
            key = (test, speed)
            histories[key], references[key] = run_atoms(test, speed), speed * unit
            found[key] = numbers(test, speed, histories[key], references[key])
    return histories, references, found


def show(found: dict) -> None:
    """Print the numbers as a table."""
    columns = ("rms", "high frequency", "rise", "surface xx", "surface yy", "surface xy")
    print(
        "RMS error of the inner atom relative to the RMS of the reference; high-frequency part\n"
        "relative to that of the virial strain; rise time; RMS errors of the surface atom: xx and\n"
        "yy relative to the RMS of their references, xy (zero at a free surface) relative to that\n"
        "of xx. By test and speed of the end. 'fed by elements': atoms with the displacements of\n"
        "the finite elements, which shows the error of the weights.\n"
    )
    for (test, speed), methods in found.items():
        print(f"{test}, {speed}".ljust(24) + "".join(name.rjust(16) for name in columns))
        for name, values in methods.items():
            cells = (
                f"{values[c]:.3f}" if np.isfinite(values.get(c, np.nan)) else "-" for c in columns
            )
            print(name.rjust(24) + "".join(cell.rjust(16) for cell in cells))
        print()


LINES = {
    "finite elements": ("finite elements", "#222222", "--", 1.4),
    "virial": ("virial", "#999999", "-", 0.8),
    "linear 2": ("linear weights, cell 2", "#0072B2", "-", 1.2),
    "linear 2.5": ("linear weights, cell 2.5", "#E69F00", "-", 1.2),
    "quadratic 2": ("quadratic weights, cell 2", "#009E73", "-", 1.2),
    "paper 2": ("paper's weights, cell 2", "#CC79A7", "-", 1.2),
}
SHOWN = (
    ("finite elements", "virial", "linear 2", "linear 2.5"),
    ("finite elements", "linear 2", "quadratic 2", "paper 2"),
)
"""Which lines the figures of the inner and of the surface atom show."""


def draw(histories: dict, references: dict, folder: Path) -> None:
    """Draw Figures 5 (inner atom) and 6 (surface atom) of the paper."""
    folder.mkdir(exist_ok=True)
    speed = SPEEDS[0]
    panels = {
        "inner-atom": [("tension", 0, XX, "xx"), ("shear", 0, XY, "xy")],
        "surface-atom": [
            ("tension", 1, XX, "xx, along the surface"),
            ("tension", 1, YY, "yy, normal"),
            ("tension", 1, XY, "xy, zero at a free surface"),
        ],
    }
    for name, plots in panels.items():
        figure, axes = pyplot.subplots(
            1, len(plots), figsize=(4.6 * len(plots), 3.6), layout="constrained"
        )
        for axis, (test, atom, component, what) in zip(axes, plots, strict=True):
            atoms, reference = histories[test, speed], references[test, speed]
            for method in SHOWN[atom]:
                label, colour, style, width = LINES[method]
                strain = reference if method == "finite elements" else atoms.strain[method]
                axis.plot(
                    atoms.time,
                    strain[:, atom, component],
                    style,
                    color=colour,
                    lw=width,
                    label=label,
                )
            axis.set(title=f"{test}, v = {speed}", xlabel="time", ylabel=f"strain {what}")
            axis.set_xlim(0, END)
            axis.spines[["top", "right"]].set_visible(False)
        axes[0].legend(frameon=False, fontsize=9)
        figure.savefig(folder / f"{name}.png", dpi=150)
        pyplot.close(figure)


def main() -> int:
    """Run, print, draw."""
    histories, references, found = compute()
    show(found)
    folder = Path("figures")
    draw(histories, references, folder)
    print(f"figures in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
