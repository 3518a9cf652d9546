"""Which sides take part, what each of them needs, and whether all of it has the same dimension."""

from __future__ import annotations

from collections.abc import Sequence

from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.form import Case, Md


def check_sides(case: Case, rules: Rules) -> None:
    """Check which sides take part, and that the case has what each of them needs."""
    rules.require(
        case.dim == 2 or case.only is not None or case.coupling.scheme == "sites",
        "domain.box",
        case.domain.box,
        "has three dimensions, in which only the sites scheme couples atoms and continuum",
        "write coupling: {scheme: sites}, or run with --only md or --only continuum",
    )
    if case.md is None:
        rules.require(
            case.only == "continuum",
            "md",
            None,
            "missing, and the run has atoms",
            "describe the atoms, or write only: continuum",
        )
        for key, absent in (
            ("md_timestep", case.time.md_timestep is None),
            ("md_steps", case.time.md_steps == "auto"),
        ):
            rules.require(
                absent,
                f"time.{key}",
                getattr(case.time, key),
                "belongs to the atoms, but the case has no md",
                "write time.step, the step of the finest level, or leave it out",
            )
        return
    _check_region_keys(case, case.md, rules)
    rules.require(
        case.time.md_timestep is not None,
        "time.md_timestep",
        None,
        "missing",
        "give the time step of the atoms",
    )
    rules.require(
        case.time.step == "auto",
        "time.step",
        case.time.step,
        "is determined by the atoms: time.md_steps times time.md_timestep",
        "leave it out, or leave md out for a run of the continuum only",
    )


def _check_region_keys(case: Case, md: Md, rules: Rules) -> None:
    """Check that there are either one region or several, with planes for each or for none."""
    if not rules.require(
        md.region is not None or bool(md.regions),
        "md.region",
        None,
        "missing",
        "give the box of the atoms, or md.regions, a list of boxes",
    ) or not rules.require(
        md.region is None or not md.regions,
        "md.regions",
        md.regions,
        "is given in addition to md.region; only one of the two is allowed",
        "remove one of the two",
    ):
        return
    planes, count = case.coupling.planes, len(md.boxes())
    given = len(case.coupling.each_planes())
    rules.require(
        planes is None or given == count,
        "coupling.planes",
        given,
        f"are not the planes of {count} MD region{'s' if count > 1 else ''}",
        "leave them out: LAMMPS finds them",
    )


def check_lengths(case: Case, rules: Rules) -> None:
    """Check that everything with one entry for each axis has as many entries as the domain."""
    dim, continuum = case.dim, case.continuum
    per_axis: list[tuple[str, Sequence[object] | None]] = [
        ("domain.periodic", case.domain.periodic),
        *(case.md.boxes().items() if case.md else ()),
        ("md.patches", None if not case.md or case.md.patches == "auto" else case.md.patches),
        ("continuum.patches", None if continuum.patches == "auto" else continuum.patches),
    ]
    for k, level in enumerate(case.grid.levels):
        for j, box in enumerate(level.boxes):
            per_axis.append((f"grid.levels[{k}].boxes[{j}]", box))
    for index, crack in enumerate(continuum.cracks):
        key = f"continuum.cracks[{index}]"
        per_axis += [(f"{key}.from", crack.start), (f"{key}.to", crack.end)]
        per_axis.append((f"{key}.along", crack.along))
    for index, damping in enumerate(continuum.damping):
        per_axis.append((f"continuum.damping[{index}].box", damping.box))
    if continuum.body_force:
        per_axis.append(("continuum.body_force.acceleration", continuum.body_force.acceleration))
    for index in range(2 * dim):
        for key, face in case.boundary.parts(*divmod(index, 2)).items():
            if isinstance(face.value, tuple):
                per_axis.append((f"{key}.value", face.value or None))
            else:
                vectors = face.value.vectors().items()
                per_axis += [(f"{key}.value{name}", vector) for name, vector in vectors]
    for index, field in enumerate(case.initial.velocities):
        key = f"initial.velocities[{index}]"
        per_axis += [(f"{key}.velocity", field.velocity), (f"{key}.box", field.box)]
        per_axis += [(f"{key}.center", field.center), (f"{key}.gradient", field.gradient)]
        for i, row in enumerate(field.gradient or ()):
            per_axis.append((f"{key}.gradient[{i}]", row))
    if case.initial.stretch:
        stretch = case.initial.stretch
        per_axis += [("initial.stretch.gradient", stretch.gradient)]
        per_axis += [("initial.stretch.center", stretch.center)]
        for i, row in enumerate(stretch.gradient):
            per_axis.append((f"initial.stretch.gradient[{i}]", row))
    for key, entries in per_axis:
        rules.require(
            entries is None or len(entries) == dim,
            key,
            entries,
            f"must have {dim} entries, as domain.box has",
            f"write one for each of {', '.join(AXES[:dim])}",
        )
