"""A finished run of the continuum in three dimensions, made up: a plan, points and a record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import make_plan, write_plan
from tests.cases import BLOCK_3D, CASE, changed
from tests.deploy.results.files import write_record


def lattice(edge: float, box: tuple[tuple[float, float], ...]) -> Particles:
    """Cubes that tile a box, with a stress that grows along x."""
    axes = [np.arange(low + 0.5 * edge, high, edge) for low, high in box]
    x: Floats = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(box))
    stress = np.zeros((len(x), 3 if len(box) == 2 else 6))
    stress[:, 1] = x[:, 0]
    zero = np.zeros_like(x)
    return Particles(0.0, x, x, zero, zero, stress, np.full(x.shape, edge), {})


class BlockRun(Run):
    """The run; its points are made up, not read."""

    @property
    def times(self) -> list[float]:
        return [0.0]

    def particles(self, time: float) -> dict[Any, Particles]:
        return {"continuum": lattice(4.0, self.plan.domain.box)}


def make_run(folder: Path) -> Run:
    """Write the plan and the record, and open the run."""
    case = msgspec.convert(changed(CASE, BLOCK_3D), Case)
    dump_case(case, folder / "case.yaml")
    write_plan(make_plan(case), folder / "plan.yaml")
    write_record(folder / "run.h5", [5.0, 6.9, 9.0], [0.0, 2.0, 4.0], dim=3)
    return BlockRun(folder)
