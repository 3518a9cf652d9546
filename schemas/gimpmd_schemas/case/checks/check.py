"""What a case means: geometry, stability, files. All problems are found before any run."""

from __future__ import annotations

from pathlib import Path

from gimpmd_schemas.case.checks.configuration import check_configuration
from gimpmd_schemas.case.checks.cracks import check_cracks
from gimpmd_schemas.case.checks.figures import check_figures
from gimpmd_schemas.case.checks.files import check_files
from gimpmd_schemas.case.checks.geometry import check_geometry, check_size
from gimpmd_schemas.case.checks.levels import check_levels
from gimpmd_schemas.case.checks.loads import (
    check_body_force,
    check_damping,
    check_faces,
    check_initial,
)
from gimpmd_schemas.case.checks.numbers import check_numbers
from gimpmd_schemas.case.checks.patches import check_patches
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.checks.sides import check_lengths, check_sides
from gimpmd_schemas.case.checks.stability import check_stability
from gimpmd_schemas.case.checks.zones import check_absorber, check_zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import Material, check_material
from gimpmd_schemas.errors import Problem


def check_case(
    case: Case, folder: Path | None = None, spacing: float | None = None
) -> list[Problem]:
    """Check everything that can be checked without starting a service.

    Parameters
    ----------
    case : Case
    folder : Path, optional
        Folder of its LAMMPS scripts. Without it files are not checked.
    spacing : float, optional
        Distance of neighbouring atoms (length units), as LAMMPS measured it. Without it the MD
        time step is not checked.

    Returns
    -------
    list of Problem
        Empty if the case can be run.
    """
    rules = Rules()
    check_numbers(case, rules)
    check_sides(case, rules)
    check_lengths(case, rules)
    check_figures(case, rules)
    if not rules.problems:  # geometry from senseless numbers would only give more messages
        continuum = case.continuum
        check_material(continuum.material, continuum.temperature, case.dim, rules)
        check_configuration(case, rules)
        check_faces(case, rules)
        check_body_force(case, rules)
        check_damping(case, rules)
        check_initial(case, rules)
        if check_geometry(case, rules) and check_levels(case, rules):
            check_size(case, rules)
            check_zones(case, rules)
            check_absorber(case, rules)
            check_patches(case, rules)
            check_cracks(case, rules)
    if isinstance(case.continuum.material, Material) and not rules.problems:
        check_stability(case, rules, spacing)
    if folder is not None:
        check_files(case, folder, rules)
    return rules.problems
