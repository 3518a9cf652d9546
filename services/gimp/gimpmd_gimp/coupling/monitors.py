"""The monitors of the continuum's side: what makes the results of the continuum untrustworthy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gimpmd_gimp.coupling.solver_protocol import ContinuumSolver
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.wire.energies import Energies, total
from gimpmd_schemas.wire.findings import Finding, check
from gimpmd_schemas.wire.plausibility import Plausibility

SUMS = "monitors/sums"


class Monitors:
    """Monitors of the continuum on one rank; they look at the steps with energies.

    Parameters
    ----------
    plan : Plan
    solver : ContinuumSolver
    """

    def __init__(self, plan: Plan, solver: ContinuumSolver) -> None:
        self._solver, self._plausibility = solver, Plausibility(plan)

    def state(self) -> dict[str, Floats]:
        """What a run that goes on needs; the same on all ranks."""
        return {SUMS: self._plausibility.state()}

    def restore(self, state: Mapping[str, Floats]) -> None:
        """Go on from the `state` of any rank."""
        self._plausibility.restore(state[SUMS])

    def look_at_points(self) -> tuple[Finding, ...]:
        """Compare the strains of the points of this rank with the reach of the law."""
        F, x = self._solver.deformation()
        strain, point = largest_strain(F, self._solver.law.finite)
        return check("strain", strain, self._solver.law.trusted_strain, x[point]) if len(F) else ()

    def look_at_sums(self, energies: Energies) -> tuple[Finding, ...]:
        """Check the energies of the whole continuum; collective, and told by the first rank.

        Parameters
        ----------
        energies : Energies
            Of this rank, in the units of the case.
        """
        comm = self._solver.comm
        side = total([energies] if comm is None else comm.allgather(energies))
        if side is None:
            raise ValueError("a rank has no energies at this step")
        found = self._plausibility.look(side)
        return found if comm is None or comm.rank == 0 else ()


@njit(cache=True, nogil=True)
def largest_strain(F: Floats, finite: bool) -> tuple[float, int]:
    """Find the point with the largest strain.

    Parameters
    ----------
    F : ndarray, shape ``(n, d, d)``
        Deformation gradients.
    finite : bool
        Whether the strain is ``(F^T F - I) / 2``; otherwise it is ``sym(F) - I``.

    Returns
    -------
    strain : float
        Norm of the strain, the root of the sum of its squared components; 0 without points. A
        strain that is not a number is larger than all others.
    point : int
        Row of the point.
    """
    most, point, d = 0.0, 0, F.shape[1]
    for p in range(F.shape[0]):
        square = 0.0
        for i in range(d):
            for j in range(d):
                if finite:
                    strain = 0.0
                    for k in range(d):
                        strain += 0.5 * F[p, k, i] * F[p, k, j]
                else:
                    strain = 0.5 * (F[p, i, j] + F[p, j, i])
                if i == j:
                    strain -= 0.5 if finite else 1.0
                square += strain * strain
        if not square <= most:
            most, point = square, p
            if np.isnan(square):
                break
    return np.sqrt(most), point
