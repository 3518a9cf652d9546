"""Times of the levels under each integrator."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.clock import Clock


def advance(clock: Clock, steps: int) -> None:
    """Kick all levels that take part, step by step."""
    for _ in range(steps):
        levels = range(clock.coarsest(), clock.top + 1)
        clock.start_kick(levels)
        clock.end_kick(levels)
        clock.advance()


def test_steps_of_coarser_levels_are_longer_by_powers_of_two() -> None:
    clock = Clock(0.25, 2, "musl")
    assert [clock.dt_of(level) for level in clock.levels] == [1.0, 0.5, 0.25]


@pytest.mark.parametrize(
    ("integrator", "expected"),
    [
        ("musl", [0.5, 0.75, 0.875]),
        ("usavg", [0.5, 0.75, 1.0]),
        ("usl", [1.0, 1.0, 1.0]),
        ("usf", [1.0, 1.0, 1.0]),
    ],
)
def test_velocities_are_known_at_half_or_whole_steps(integrator, expected) -> None:
    clock = Clock(0.25, 2, integrator)
    assert clock.velocities_are_present()
    advance(clock, 4)
    assert clock.time == 1.0
    assert clock.steps == 4
    np.testing.assert_array_equal(clock.velocity_time, expected)
    lag = 1.0 - np.array(expected)
    np.testing.assert_allclose(clock.share_to_present() * clock.span, lag, atol=1e-15)
    assert clock.velocities_are_present() == (integrator in ("usl", "usf"))


def test_levels_meet_every_step_of_the_coarsest() -> None:
    clock = Clock(0.25, 2, "musl")
    together = []
    for _ in range(9):
        together.append(clock.synchronous())
        advance(clock, 1)
    assert together == [step % 4 == 0 for step in range(9)]


@pytest.mark.parametrize(
    ("integrator", "where"),
    [
        ("musl", ["middle", "middle"]),
        ("usavg", ["middle", "both ends"]),
        ("usl", ["end", "end"]),
    ],
)
def test_where_the_velocities_that_move_points_are_known(integrator, where) -> None:
    clock = Clock(0.25, 1, integrator)
    assert [clock.moving_velocity_at(level) for level in clock.levels] == where
