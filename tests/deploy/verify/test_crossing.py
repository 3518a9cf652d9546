"""Energy on either side of the interface, from made-up strips."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gimpmd_deploy.verify.crossing import crossing, energies


def coupled(direction: int) -> SimpleNamespace:
    """A run that ends with a tenth of its energy below the interface and the rest above."""
    time = np.linspace(0.0, 1.0, 101)
    continuum, md = np.where(time < 0.5, 1.0, 0.1), np.where(time < 0.5, 0.0, 0.9)
    return SimpleNamespace(
        plan=SimpleNamespace(
            only=None, initial=SimpleNamespace(packets=[SimpleNamespace(direction=direction)])
        ),
        energies=SimpleNamespace(
            time=time,
            energy=continuum + md,
            continuum=SimpleNamespace(energy=continuum),
            md=SimpleNamespace(energy=md, kinetic=0.5 * md),
        ),
    )


@pytest.mark.parametrize(("direction", "shares"), [(1, (0.1, 0.9)), (-1, (0.9, 0.1))])
def test_shares_of_a_coupled_strip(direction: int, shares: tuple[float, float]) -> None:
    assert crossing(coupled(direction)) == pytest.approx(shares)
    assert sum(energies(coupled(direction)))[-1] == pytest.approx(1.0)
