"""Files that LAMMPS reads for a run."""

from __future__ import annotations

from gimpmd_schemas.case.form import Case, MeasuredByMd


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
