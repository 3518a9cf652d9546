"""Files that the services read, and the variables of the scripts of the MD code."""

from __future__ import annotations

from gimpmd_schemas.case.derive.regions import md_region
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.grid.zones import Box


def scripts(case: Case) -> list[tuple[str, str]]:
    """Key and name of every file that LAMMPS reads for this run; empty if it reads none."""
    material, named = case.continuum.material, []
    if case.md is not None and case.only != "continuum":
        named.append(("md.input", case.md.input))
        if case.md.after is not None:
            named.append(("md.after", case.md.after))
    if isinstance(material, MeasuredByMd):
        named.append(("continuum.material.cell", material.cell))
    if named and case.md is not None:  # a script may read these
        named += [(f"md.files[{i}]", name) for i, name in enumerate(case.md.files)]
    return named


def input_files(case: Case) -> list[tuple[str, str]]:
    """Key and name of every file beside the case that a service reads for this run."""
    found, mesh = scripts(case), case.continuum.mesh
    if mesh is not None and case.only != "md":
        found.append(("continuum.mesh", mesh))
    return found


def script_variables(case: Case) -> dict[str, float | str]:
    """Variables for the scripts of the MD code: those of the case, and the boxes of the atoms.

    ``xlo xhi ylo yhi``, with ``zlo zhi`` in three dimensions, are the box around all atoms. If the
    case lists ``md.regions``, each of them has its own: ``xlo1 xhi1 ylo1 yhi1`` and so on.
    """
    variables = dict(case.atoms.variables) | _box_variables(md_region(case), "")
    for number, box in enumerate(case.atoms.regions, 1):
        # in a run of MD only every region is the whole domain
        variables |= _box_variables(case.domain.box if case.only == "md" else box, str(number))
    return variables


def _box_variables(box: Box, number: str) -> dict[str, float | str]:
    return {
        f"{axis}{end}{number}": value
        for axis, sides in zip("xyz", box, strict=False)
        for end, value in zip(("lo", "hi"), sides, strict=True)
    }
