"""Fields that a case wants to have drawn."""

from __future__ import annotations

from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.mechanics.elasticity import VOIGT

SCALARS = (
    *("pressure", "von_mises", "speed", "energy_density", "potential_energy", "temperature"),
    *("type", "level", "equivalent_plastic_strain"),
)


def figure_fields(dim: int) -> tuple[str, ...]:
    """Names of the fields that figures of a case can show, in any of its runs."""
    axes, pairs = AXES[:dim], [AXES[i] + AXES[j] for i, j in VOIGT[dim]]
    vectors = [f"{name}_{axis}" for name in ("velocity", "displacement") for axis in axes]
    tensors = [f"{name}_{pair}" for name in ("sigma", "strain") for pair in pairs]
    return (*tensors, *vectors, *SCALARS)


def check_figures(case: Case, rules: Rules) -> None:
    """Check the names in ``output.figures``."""
    known = figure_fields(case.dim)
    for index, name in enumerate(case.output.figures):
        rules.require(
            name in known,
            f"output.figures[{index}]",
            name,
            "is not a field that figures show",
            f"choose from {', '.join(known)}",
        )
