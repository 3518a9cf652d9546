"""The verdict of a verification: what the strips showed, and the criterion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

import msgspec

from gimpmd_deploy.verify.strips import Ground, Travel
from gimpmd_deploy.verify.tasks import Task
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.times import md_steps

MORE_REFLECTED, OFF_TRANSMITTED = 0.01, 0.03
CRITERION = (
    f"R at most the grid's own + {MORE_REFLECTED:g}, T within {OFF_TRANSMITTED:g} of 1, "
    "into the atoms and out of them, P and S waves"
)


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of a packet's energy that the interface reflects and transmits.

    Attributes
    ----------
    wavelength : of the wave (cells).
    degrees : angle between the direction of travel and the normal of the interface.
    travel : ``into`` the atoms or ``out`` of them.
    grid_reflected, grid_transmitted : shares of the same packet in the continuum only.
    md_reflected, md_transmitted : shares in MD only; null if this was not run.
    faithful : whether the criterion holds.
    """

    wavelength: float
    polarization: Literal["P", "S"]
    degrees: float
    travel: Travel
    reflected: float
    transmitted: float
    grid_reflected: float
    grid_transmitted: float
    md_reflected: float | None
    md_transmitted: float | None
    faithful: bool


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """Which waves cross the interface of a case.

    Attributes
    ----------
    cell : edge of the cells of the strips.
    case_cell : edge of the finest cells of the case.
    shortest : shortest wavelength (cells) for which this wave and all longer ones that were run
        cross faithfully; null if there is none.
    """

    case: str
    scheme: str
    md_steps: int
    axis: Literal["x", "y", "z"]
    cell: float
    case_cell: float
    criterion: str
    shortest: float | None
    rows: list[Row]


def judge(ground: Ground, shares: Mapping[Task, tuple[float, float]]) -> Verdict:
    """Return the verdict; rows in the order of wavelength, angle, polarization and way."""
    rows = []
    coupled = [task for task in shares if task.only is None]
    for task in sorted(coupled, key=lambda t: (t.wave.wavelength, t.wave.degrees, t.name)):
        reflected, transmitted = shares[task]
        grid = shares[Task(task.wave, "into", "continuum")]
        md = shares.get(Task(task.wave, "into", "md"), (None, None))
        rows.append(
            Row(
                wavelength=task.wave.wavelength,
                polarization=task.wave.polarization,
                degrees=task.wave.degrees,
                travel=task.travel,
                reflected=reflected,
                transmitted=transmitted,
                grid_reflected=grid[0],
                grid_transmitted=grid[1],
                md_reflected=md[0],
                md_transmitted=md[1],
                faithful=is_faithful(reflected, transmitted, grid[0]),
            )
        )
    case = ground.case
    return Verdict(
        case=case.name,
        scheme=case.coupling.scheme,
        md_steps=md_steps(case),
        axis="xyz"[ground.axis],  # type: ignore[arg-type]
        cell=ground.cell,
        case_cell=finest_cell(case),
        criterion=CRITERION,
        shortest=shortest_faithful(rows),
        rows=rows,
    )


def is_faithful(reflected: float, transmitted: float, grid_reflected: float) -> bool:
    """Whether a wave meets the criterion."""
    return (
        reflected <= grid_reflected + MORE_REFLECTED and abs(transmitted - 1.0) <= OFF_TRANSMITTED
    )


def shortest_faithful(rows: Iterable[Row]) -> float | None:
    """Return the shortest wavelength that is faithful together with all longer ones, or None."""
    shortest = None
    by_length: dict[float, bool] = {}
    for row in rows:
        by_length[row.wavelength] = by_length.get(row.wavelength, True) and row.faithful
    for length in sorted(by_length, reverse=True):
        if not by_length[length]:
            break
        shortest = length
    return shortest
