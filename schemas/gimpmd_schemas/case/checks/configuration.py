"""Which choices for the continuum go together."""

from __future__ import annotations

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.choices import (
    configuration,
    dispersion,
    integrator,
    is_coupled_at_planes,
)
from gimpmd_schemas.case.form import AT_PLANES, Case


def check_configuration(case: Case, rules: Rules) -> None:
    """Check who reads a mesh, and what the reference configuration and the dispersion need."""
    continuum, fixed = case.continuum, configuration(case) == "reference"
    scheme = case.coupling.scheme if case.only is None else None
    rules.require(
        continuum.mesh is None or continuum.backend != "gimp" or bool(continuum.command),
        "continuum.mesh",
        continuum.mesh,
        "is for finite elements; the material points of GIMP fill the grid",
        "write continuum.backend: fem, or leave the mesh out",
    )
    rules.require(
        scheme not in AT_PLANES or fixed,
        "continuum.configuration",
        continuum.configuration,
        f"does not fit the {scheme} scheme, whose ghost atoms are tied to the grid at rest",
        "write auto",
    )
    rules.require(
        scheme != "paper" or not fixed,
        "continuum.configuration",
        continuum.configuration,
        "does not fit the paper scheme, whose inner points follow atoms over the grid",
        "write auto, or coupling.scheme: velocity",
    )
    rules.require(
        not fixed or is_coupled_at_planes(case) or continuum.interpolation != "cpgimp",
        "continuum.interpolation",
        continuum.interpolation,
        "has no effect in the reference configuration, where points keep their size",
        "write ugimp, which allows large strains there, or continuum.configuration: current",
    )
    every = continuum.xpic.every
    rules.require(
        not fixed or every in ("auto", 0),
        "continuum.xpic.every",
        every,
        "would filter only waves in the reference configuration, where weights never change",
        "write auto",
    )
    if dispersion(case) == "lumped":
        return
    key, value = "continuum.dispersion", continuum.dispersion
    rules.require(
        scheme in (None, *AT_PLANES),
        key,
        value,
        f"cannot be corrected in the {scheme} scheme, whose filter and projections use the grid "
        "without correction",
        "leave dispersion out",
    )
    rules.require(
        fixed,
        key,
        value,
        "is available in the reference configuration only",
        "write continuum.configuration: reference as well, or leave dispersion out",
    )
    rules.require(
        integrator(case) == "musl",
        "continuum.integrator",
        continuum.integrator,
        "cannot be combined with corrected dispersion",
        "write auto or musl, or continuum.dispersion: lumped",
    )
    rules.require(
        continuum.interpolation in ("ugimp", "linear", "cpgimp"),
        "continuum.interpolation",
        continuum.interpolation,
        "has another dispersion than the one that the correction removes",
        "write ugimp, or continuum.dispersion: lumped",
    )
