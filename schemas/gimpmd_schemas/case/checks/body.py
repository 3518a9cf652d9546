"""What the continuum is made of: material and cracks."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.case.checks.levels import CRACK_MARGIN, crack_level
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.levels import cells as level_cells
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import (
    J2,
    Anisotropic,
    Case,
    Crack,
    Elastic,
    Hyperelastic,
    Isotropic,
    MeasuredByMd,
    PairLattice,
)
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.hyperelastic import degree_of

SOFTEST = 1e-9
"""Least ratio of a stiffness matrix's smallest and largest eigenvalue."""

J_CELLS = 2
"""Least radius of a J-integral's domain, in cells."""


def check_material(case: Case, rules: Rules) -> None:
    """Density and moduli of a stable material, fit for the number of dimensions."""
    material, key = case.continuum.material, "continuum.material"
    _check_temperature(case, rules)
    if isinstance(material, MeasuredByMd):
        rules.require(
            case.dim == 2,
            f"{key}.from",
            "md",
            "LAMMPS measures materials in two dimensions for now",
            "give the moduli: from: moduli or from: stiffness",
        )
        return
    rules.require(material.density > 0, f"{key}.density", material.density, "must be positive")
    if isinstance(material, Anisotropic):
        _check_stiffness(material, case.dim, rules)
    else:
        _check_moduli(material, case.dim, rules)
    if isinstance(material, Hyperelastic):
        _check_energy(material, case.dim, rules)
    if isinstance(material, PairLattice):
        _check_bonds(material, case.dim, rules)
    if isinstance(material, J2):
        _check_yield(material, rules)
    if isinstance(material, Elastic) and material.plane == "stress":
        rules.require(
            case.dim == 2 and material.model == "linear",
            f"{key}.plane",
            "stress",
            "is available in two dimensions with linear elasticity only",
            "leave plane out",
        )


def _check_temperature(case: Case, rules: Rules) -> None:
    temperature, material = case.continuum.temperature, case.continuum.material
    if temperature is None:
        return
    key = "continuum.temperature"
    rules.require(temperature >= 0, key, temperature, "must not be negative")
    # whether a crystal that LAMMPS measures is bound in pairs shows once it has been measured
    vibrates = isinstance(material, PairLattice) or (
        isinstance(material, MeasuredByMd) and material.model == "cauchy-born"
    )
    rules.require(
        vibrates,
        key,
        temperature,
        "needs the bonds of the continuum's crystal, which has one atom in its primitive cell and "
        "is bound in pairs; without them its thermal stress is not known",
        "write continuum.material: {from: md, model: cauchy-born, cell: ...} for such a crystal, "
        "or leave the key out",
    )


def _check_moduli(material: Isotropic, dim: int, rules: Rules) -> None:
    key, lame, shear = "continuum.material", material.lame, material.shear
    rules.require(shear > 0, f"{key}.shear", shear, "must be positive")
    sheet = isinstance(material, Elastic) and material.plane == "stress"
    # plasticity strains a body across the plane too
    in_plane = dim == 2 and not sheet and not isinstance(material, J2)
    # the bulk modulus, lambda + 2 mu / d in d dimensions, must be positive
    share = 1.0 if in_plane else 2.0 / 3.0
    rules.require(
        lame + share * shear > 0.0,
        f"{key}.lame",
        lame,
        f"must exceed {-share * shear:g}, minus {'' if in_plane else '2/3 of '}the shear modulus, "
        "for a stiff material",
    )


def _check_yield(material: J2, rules: Rules) -> None:
    key = "continuum.material"
    rules.require(
        material.yield_stress > 0,
        f"{key}.yield_stress",
        material.yield_stress,
        "must be positive",
        "for a material that does not yield write from: moduli",
    )
    rules.require(
        material.hardening >= 0,
        f"{key}.hardening",
        material.hardening,
        "must not be negative: a material that softens has no unique solution",
        "write 0 for ideal plasticity",
    )


def _check_energy(material: Hyperelastic, dim: int, rules: Rules) -> None:
    key, count, strains = "continuum.material", len(material.coefficients), len(VOIGT[dim])
    rules.require(
        material.strain_limit > 0, f"{key}.strain_limit", material.strain_limit, "must be positive"
    )
    rules.require(
        degree_of(strains, count) is not None,
        f"{key}.coefficients",
        count,
        f"numbers are not those of a polynomial in {strains} strains",
        "let LAMMPS find them: from: md with model: cauchy-born",
    )


def _check_bonds(material: PairLattice, dim: int, rules: Rules) -> None:
    key, way_out = "continuum.material", "let LAMMPS find them: from: md with model: cauchy-born"
    rules.require(
        dim == 2, f"{key}.from", "lattice", "is available in two dimensions only", "give the moduli"
    )
    for name in ("area", "stretch_limit"):
        value = getattr(material, name)
        rules.require(value > 0, f"{key}.{name}", value, "must be positive")
    rules.require(
        bool(material.bonds) and all(any(bond) for bond in material.bonds),
        f"{key}.bonds",
        material.bonds,
        "must contain vectors of nonzero length",
        way_out,
    )
    rules.require(
        len(material.energy) == len(material.bonds) and all(map(len, material.energy)),
        f"{key}.energy",
        len(material.energy),
        f"must have a list of coefficients for each of {len(material.bonds)} bonds",
        way_out,
    )


def _check_stiffness(material: Anisotropic, dim: int, rules: Rules) -> None:
    key, n = "continuum.material.stiffness", len(VOIGT[dim])
    rows = [len(row) for row in material.stiffness]
    if not rules.require(
        rows == [n] * n,
        key,
        rows,
        f"must be a matrix of {n} rows of {n} numbers in {dim} dimensions",
        "order the rows xx, yy, xy" if dim == 2 else "order the rows xx, yy, zz, yz, xz, xy",
    ):
        return
    matrix = np.array(material.stiffness)
    size = float(np.abs(matrix).max())
    if not rules.require(
        float(np.abs(matrix - matrix.T).max()) <= SOFTEST * size,
        key,
        material.stiffness,
        "must be symmetric",
        "let C[i][j] equal C[j][i]",
    ):
        return
    softest = float(np.linalg.eigvalsh(matrix / size)[0]) if size > 0.0 else 0.0
    rules.require(
        softest > SOFTEST,
        key,
        material.stiffness,
        f"must be positive definite; its smallest eigenvalue is {softest * size:.3g}",
        "check signs and order of the entries",
    )


def check_cracks(case: Case, rules: Rules) -> None:
    """Cracks inside the body, of one level, and out of the coupling's way."""
    rules.require(
        not (case.continuum.cracks and any(case.domain.periodic)),
        "continuum.cracks",
        len(case.continuum.cracks),
        "cracks of the continuum cannot be combined with periodic axes yet",
        "make the domain free along all axes, or leave the cracks out",
    )
    for index, crack in enumerate(case.continuum.cracks):
        _check_crack(case, crack, f"continuum.cracks[{index}]", rules)


def _check_crack(case: Case, crack: Crack, key: str, rules: Rules) -> None:
    ends = [list(crack.start), list(crack.end)]
    line = np.array(crack.end) - np.array(crack.start)
    if not rules.require(
        bool(line.any()), key, ends, "has no length", "let from and to differ"
    ) or not rules.require(
        (crack.along is None) == (case.dim == 2),
        f"{key}.along",
        crack.along,
        "belongs to cracks in three dimensions" if crack.along else "missing in three dimensions",
        "leave it out" if crack.along else "give the vector that makes from and to a parallelogram",
    ):
        return
    if crack.along is not None and not rules.require(
        bool(np.cross(line, crack.along).any()),
        f"{key}.along",
        crack.along,
        "is parallel to the crack, so the crack has no area",
        "give a vector that is not parallel to it",
    ):
        return
    rules.require(crack.friction >= 0, f"{key}.friction", crack.friction, "must not be negative")
    rules.require(
        crack.friction == 0 or crack.contact == "frictional",
        f"{key}.friction",
        crack.friction,
        "has no meaning without contact",
        "write contact: frictional",
    )
    first = case.continuum.cracks[0]
    rules.require(
        (crack.contact, crack.friction) == (first.contact, first.friction),
        f"{key}.contact",
        crack.contact,
        "differs from the first crack's, in kind or friction",
        "give all cracks the same contact and friction",
    )
    inside = True
    for corner in crack.corners():
        inside &= rules.require(
            all(lo <= x <= hi for x, (lo, hi) in zip(corner, case.domain.box, strict=True)),
            key,
            ends,
            f"its end ({', '.join(f'{x:g}' for x in corner)}) leaves the domain",
            f"the domain is {' x '.join(f'[{lo:g}, {hi:g}]' for lo, hi in case.domain.box)}",
        )
    if not inside:
        return
    level = crack_level(case, crack)
    if rules.require(
        level is not None,
        key,
        ends,
        f"comes within {CRACK_MARGIN} cells of the rim of a level, or crosses it",
        f"let it lie, with {CRACK_MARGIN} cells to spare, in a box of one level and in no finer",
    ):
        _check_j_integral(case, crack, level_cells(case)[level or 0], key, rules)
    if case.only is None:
        zones = zones_of(case)
        corners = np.array(ends, dtype=float)
        rules.require(
            any((one.depth(corners) > zones.innermost).all() for one in zones.regions),
            key,
            ends,
            "reaches the zones or the continuum of the coupled run",
            "cracks belong inside an MD region, deeper than the inner zone",
        )


def _check_j_integral(case: Case, crack: Crack, h: float, key: str, rules: Rules) -> None:
    radius = crack.j_radius
    if radius is None:
        return
    length = float(np.linalg.norm(np.array(crack.end) - np.array(crack.start)))
    room = min(
        min(x - lo, hi - x)
        for x, (lo, hi) in list(zip(crack.end, case.domain.box, strict=True))[:2]
    )
    most = min(length, room)
    rules.require(
        J_CELLS * h <= radius <= most,
        f"{key}.j_radius",
        radius,
        f"must lie between {J_CELLS} cells ({J_CELLS * h:g}) and {most:g}, where the domain or "
        "the crack ends",
        "leave it out to skip the J-integral",
    )
