"""Short waves that run into corners of planes of the sites scheme, with the absorber."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.physics.interface.corner_packets import left, plane, run_packet, space

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

BACK = 0.05
"""Required: share of the energy that may come back."""


@pytest.mark.parametrize("length", [0.867, 2.0, 3.0, 3.5, 4.0])
@pytest.mark.parametrize("kind", ["P", "S"])
def test_the_absorber_takes_short_waves(kind: str, length: float, tmp_path: Path) -> None:
    assert left(run_packet(plane(), kind, length, {}, tmp_path)) < BACK


def test_without_absorber_they_come_back(tmp_path: Path) -> None:
    """So the test above can fail."""
    assert left(run_packet(plane(), "P", 2.0, None, tmp_path)) > 0.9


def test_the_absorber_takes_short_waves_of_copper(tmp_path: Path) -> None:
    assert left(run_packet(space(9.0), "S", 3.0, {}, tmp_path)) < BACK
