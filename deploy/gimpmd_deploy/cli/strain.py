"""``gimpmd strain dump``: strain of the atoms in a LAMMPS dump."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.cli.options import Json, print_json
from gimpmd_deploy.launch.strain import default_output, strain_of_dump


class StrainMethod(StrEnum):
    """How strain is computed (see docs/atomic-strain.md)."""

    incremental = "incremental"
    total = "total"
    virial = "virial"


class StrainWeights(StrEnum):
    """Weights of the grid; the first two are exact, or nearly, for fields of that order."""

    linear = "linear"
    quadratic = "quadratic"
    gimp = "gimp"


class StrainMeasure(StrEnum):
    """Strain tensor of the total displacement."""

    infinitesimal = "infinitesimal"
    green = "green"
    almansi = "almansi"


def strain_dump(
    dump: Annotated[Path, typer.Argument(metavar="DUMP", help="LAMMPS text dump, .gz too.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The dump with strains.")
    ] = None,
    method: Annotated[StrainMethod, typer.Option("--method")] = StrainMethod.incremental,
    reference: Annotated[
        str, typer.Option("--reference", help="Undeformed state: first, a step, or another dump.")
    ] = "first",
    cell: Annotated[float | None, typer.Option("--cell", help="Edge of the grid's cells.")] = None,
    spacing: Annotated[float | None, typer.Option("--spacing", help="Edge of an atom.")] = None,
    weights: Annotated[StrainWeights | None, typer.Option("--weights")] = None,
    measure: Annotated[StrainMeasure | None, typer.Option("--measure")] = None,
    cutoff: Annotated[
        float | None, typer.Option("--cutoff", help="Range of neighbours, for virial.")
    ] = None,
    dimension: Annotated[int | None, typer.Option("--dimension", min=2, max=3)] = None,
    ranks: Annotated[int, typer.Option("--ranks", min=1, help="MPI ranks.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the output.")] = False,
    as_json: Json = False,
) -> None:
    """Write a copy of a dump with the strain of every atom in new columns; OVITO opens it."""
    options = {
        "method": method,
        "reference": reference,
        "cell": cell,
        "spacing": spacing,
        "weights": weights,
        "measure": measure,
        "cutoff": cutoff,
        "dimension": dimension,
    }
    target = out or default_output(dump)
    summary = strain_of_dump(dump, target, options, ranks, force)
    if as_json:
        print_json(summary)
        return
    width = f"neighbours within {summary.cutoff:.4g}" if summary.cutoff else ""
    width = f"cells of {summary.cell:.4g}" if summary.cell else width
    typer.echo(
        f"{target}: {', '.join(summary.columns)} of {summary.atoms:,} atoms in {summary.frames} "
        f"frames ({summary.method}, {width}, from step {summary.reference})"
    )
    if summary.undefined:
        typer.echo(
            f"{summary.undefined:,} atoms of the last frame have no strain (nan): their neighbours "
            + ("lie on one side" if summary.method == "virial" else "are too few")
        )
