"""A many-body potential with a close-packed plane: pairs that repel, atoms embedded by a root."""

from __future__ import annotations

from pathlib import Path

import numpy as np

CUTOFF, POINTS = 2.5, 4000

STYLE = "pair_style eam/alloy\npair_coeff * * embedded.eam X\n"
"""Commands of LAMMPS, beside the file that ``write_potential`` makes."""


def write_potential(folder: Path) -> None:
    """``sum_i -sqrt(sum_j exp(-4 (r - 1)) w) + 0.15 sum_ij exp(-10 (r - 1)) w``, as a setfl file.

    With ``w = (1 - (r / cutoff)^2)^4`` all is smooth where neighbours leave.
    """
    r = CUTOFF / (POINTS - 1) * np.arange(POINTS)
    rho = 20.0 / (POINTS - 1) * np.arange(POINTS)
    fade = (1.0 - np.minimum(r / CUTOFF, 1.0) ** 2) ** 4
    density, pair = np.exp(-4.0 * (r - 1.0)) * fade, 0.3 * np.exp(-10.0 * (r - 1.0)) * fade
    values = np.concatenate([-np.sqrt(rho), density, r * pair])
    head = f"\n\n\n1 X\n{POINTS} {rho[1]:.16g} {POINTS} {r[1]:.16g} {CUTOFF}\n1 1.0 1.0 hex\n"
    text = head + "".join(f"{value:.16e}\n" for value in values)
    (folder / "embedded.eam").write_text(text)
