"""Energy that a wave packet leaves on either side of the interface at the end of a run."""

from __future__ import annotations

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS


def crossing(run: Run) -> tuple[float, float]:
    """Return the reflected and the transmitted fraction of the energy of a strip's packet.

    In a coupled strip each side counts its own energy. In a strip of one side the energy is counted
    on either side of the plane where the interface would be. For atoms twice the kinetic energy
    counts, which is the total energy of a travelling wave. Their potential energy is not used: next
    to the plane it is of first order in the displacements, since the other side has a part of their
    bonds, and it oscillates by a tenth of the packet's energy.

    "Reflected" is all energy that is left on the side where the packet started. This includes
    strain that the grid cannot see.
    """
    packet = run.plan.initial.packets[0]
    if run.plan.only is None:
        lower, upper = float(energies(run)[0][-1]), _atoms_at_end(run)
    else:
        [region] = run.case.atoms.boxes().values()
        plane = region[packet.axis][0]
        x, start, end = (_points if run.plan.only == "continuum" else _atoms)(run)
        below = x[:, packet.axis] < plane
        lower, upper = (float(end[part].sum() / start.sum()) for part in (below, ~below))
    return (lower, upper) if packet.direction == 1 else (upper, lower)


def _atoms_at_end(run: Run) -> float:
    """Twice the kinetic energy of the atoms over the total energy at the start.

    It is the mean over the last twentieth of the run: where a packet is reflected at an end of the
    strip, its energy oscillates between kinetic and potential.
    """
    time, kinetic = run.energies.time, run.energies.md.kinetic
    return float(2.0 * kinetic[time >= 0.95 * time[-1]].mean() / run.energies.energy[0])


def energies(run: Run) -> tuple[Floats, Floats]:
    """Return the energy of continuum and atoms over time, over the total at the start."""
    continuum, md = run.energies.continuum.energy, run.energies.md.energy
    total = continuum[0] + md[0]
    return continuum / total, md / total


def _points(run: Run) -> tuple[Floats, Floats, Floats]:
    """Sites of the material points, and their energies at the start and at the end."""
    units, density = UNITS[run.plan.units], run.plan.continuum.material.density
    start, end = run.points(0.0), run.points()
    volume, stress = start.size.prod(axis=1), units.stress_to_mechanical(1.0)
    before, after = (
        volume
        * (
            density * (points.velocity**2).sum(axis=1)
            + stress * (points.stress * points.fields["strain"]).sum(axis=1)
        )
        for points in (start, end)
    )
    return start.reference, before, after


def _atoms(run: Run) -> tuple[Floats, Floats, Floats]:
    """Sites of the atoms, and their squared velocities at the start and at the end.

    Masses are left out: in these waves the atoms of a primitive cell move together.
    """
    start, end = run.atoms(0.0), run.atoms()
    return start.reference, *((atoms.velocity**2).sum(axis=1) for atoms in (start, end))
