"""The state of a solver as arrays, from which a run continues with the same bits.

A state holds the points, with their history variables, and the clocks and works of the solver. It
does not hold the mesh, law, method and conditions: restore into a solver that was built from the
same case. On the same number of ranks the run goes on with the same bits, on another number up to
round-off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from gimpmd_gimp.boundary.condition import Condition
from gimpmd_gimp.points.material_points import MaterialPoints, join
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.checkpoint.states import TOTAL, SavedStates
from gimpmd_schemas.errors import BackendError

Array = np.ndarray[Any, np.dtype[Any]]


def renew(solver: Solver) -> None:
    """Sort the points and project their velocities, as `restore` does; collective.

    In the reference configuration points never change places.

    Raises
    ------
    ValueError
        The levels have not all reached the present time.
    """
    if not solver.clock.synchronous():
        raise ValueError(
            f"levels stand at different times after {solver.steps} steps; a checkpoint is possible "
            f"every {2**solver.top} steps"
        )
    if not solver.body.total_lagrangian:
        solver.refresh()
        solver.regroup()
    solver.stages.project()


def state(solver: Solver) -> dict[str, Array]:
    """All that changes during a run, after `renew`; see `checkpoint.states`."""
    points, clock, work = solver.points, solver.clock, solver.work
    arrays = {f"points/{field.name}": getattr(points, field.name) for field in fields(points)}
    arrays |= {
        "clock/time": np.asarray(clock.time),
        "clock/steps": np.asarray(clock.steps),
        "clock/velocity_time": clock.velocity_time,
        "clock/span": clock.span,
        TOTAL + "works": np.array([work.external, work.interface, work.damped]),
    }
    for number, condition in enumerate(solver.conditions):
        kept = condition.state()
        arrays |= {name: kept[key] for key, name in _names(number, condition).items()}
    return {name: np.array(array) for name, array in arrays.items()}


def restore(solver: Solver, saved: SavedStates) -> None:
    """Set a solver that was built from the same case to a saved state; collective.

    Raises
    ------
    BackendError
        The state was saved by another number of ranks, and conditions keep a state of their own.
    """
    own = saved.own if saved.same_ranks else next(saved.parts())
    clock, work = solver.clock, solver.work
    clock.time, clock.steps = float(own["clock/time"]), int(own["clock/steps"])
    clock.velocity_time[:], clock.span[:] = own["clock/velocity_time"], own["clock/span"]
    work.external, work.interface, work.damped = saved.total("works").tolist()
    for number, condition in enumerate(solver.conditions):
        names = _names(number, condition)
        if names and not saved.same_ranks:
            raise BackendError(
                f"GIMP: {type(condition).__name__} has a state on each rank, which other ranks "
                f"cannot take over; go on with {len(saved.paths)} ranks"
            )
        condition.restore({key: own[name] for key, name in names.items()})
    if saved.same_ranks:
        solver.arrange(_points(own))
    else:
        parts = [_points(part) for part in saved.parts()]
        solver.settle(join(parts[saved.rank :: saved.ranks] or [_none(parts[0])]))
        solver.stages.project()


def _points(arrays: Mapping[str, Array]) -> MaterialPoints:
    return MaterialPoints(
        **{one.name: arrays[f"points/{one.name}"] for one in fields(MaterialPoints)}
    )


def _none(points: MaterialPoints) -> MaterialPoints:
    return MaterialPoints(**{one.name: getattr(points, one.name)[:0] for one in fields(points)})


def _names(number: int, condition: Condition) -> dict[str, str]:
    """Name in the state of each part of the state of a condition."""
    return {key: f"conditions/{number}/{key}" for key in condition.state()}
