"""The domain integral of a uniform field is known in closed form."""

import numpy as np
import pytest

from gimpmd_schemas.mechanics.energy_momentum import domain_integral


def test_a_uniform_field():
    P, H, dq = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[5.0, 6.0], [7.0, 8.0]]), [0.5, 0.25]
    per_volume = sum(P[i, j] * H[i, 0] * dq[j] for i in range(2) for j in range(2)) - 10.0 * dq[0]
    volume = np.array([1.0, 2.0, 3.0])
    many = [np.tile(field, (3, 1, 1)) for field in (P, H)]
    found = domain_integral(volume, *many, np.full(3, 10.0), np.tile(dq, (3, 1)))
    assert found == pytest.approx(6.0 * per_volume)
