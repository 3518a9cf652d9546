"""The strips of a verification: which waves are sent, which way, and through what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gimpmd_deploy.verify.strips import Ground, Travel, Wave
from gimpmd_schemas.case.derive.material import material
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.materials import is_isotropic

WAVELENGTHS = {2: (6.0, 8.0, 12.0, 20.0, 40.0), 3: (6.0, 8.0)}
QUICK = {2: (8.0, 20.0), 3: (8.0,)}
"""Wavelengths (cells) of a whole verification and of a quick one, by dimension: a strip of three
dimensions has many atoms."""

ANGLE = 30.0
"""Angle of the oblique waves (degrees); a strip comes as near to it as it can."""
LONGEST_OBLIQUE = 12.0
"""Longest oblique wave (cells): its strip is about twice as wide as the wave is long."""

KINDS: tuple[Literal["P", "S"], ...] = ("P", "S")


@dataclass(frozen=True)
class Task:
    """One strip to run: coupled, or one side ``only`` for comparison."""

    wave: Wave
    travel: Travel
    only: Role | None = None

    @property
    def name(self) -> str:
        """Name of the folder of the strip."""
        return f"{self.wave.label}-{self.only or self.travel}"


def plan_tasks(ground: Ground, wavelengths: Sequence[float], quick: bool) -> list[Task]:
    """Return all strips to run, those with the longest waves first.

    Oblique waves need an isotropic material, whose P and S waves are pure. Strips of atoms only
    cost as much as all others together, and are left out in three dimensions.
    """
    waves = [Wave(length, kind) for length in wavelengths for kind in KINDS]
    if not quick and is_isotropic(material(ground.case)):
        waves += [
            ground.oblique(length, kind, ANGLE)
            for length in wavelengths
            if length <= LONGEST_OBLIQUE
            for kind in KINDS
        ]
    waves.sort(key=lambda wave: (wave.wavelength, wave.degrees), reverse=True)
    tasks = []
    for wave in waves:
        tasks += [Task(wave, "into"), Task(wave, "out"), Task(wave, "into", "continuum")]
        if not quick and ground.case.dim == 2:
            tasks.append(Task(wave, "into", "md"))
    return tasks
