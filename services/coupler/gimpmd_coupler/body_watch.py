"""The monitor of the whole body: energy that comes from nowhere, in the velocity schemes.

There no side can tell how much energy the other one has given to it. The coupler knows the energies
of both sides. What they gain together has to come from somewhere; what they lose need not go
anywhere, because these schemes take short waves out (docs/monitors.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec.structs import replace

from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.wire.energies import Energies, total
from gimpmd_schemas.wire.findings import Finding, check, monitors_look
from gimpmd_schemas.wire.plausibility import GAIN, Gain


class BodyWatch:
    """Compares the energy of the whole body with what has been there, or has been done as work.

    Parameters
    ----------
    plan : Plan
        With a scheme with planes and in runs of one side it looks at nothing: there the sides do.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._gain = plan, Gain(plan)
        self._watched = plan.coupling is not None and plan.coupling.scheme not in AT_PLANES

    def looks(self, step: int) -> bool:
        """Whether it looks at a coupling step."""
        return self._watched and monitors_look(self._plan, step)

    def look(self, sides: Sequence[Energies | None]) -> tuple[Finding, ...]:
        """Check the energies of both sides at one step.

        Parameters
        ----------
        sides : sequence of Energies or None
            Sums over the ranks of each side. Work of the interface is no source: all that the
            sides do to each other stays in the body.
        """
        body = total(sides)
        if body is None:
            return ()
        return check("total energy", self._gain.share(replace(body, interface_work=0.0)), GAIN)

    def catch_up(self, earlier: Iterable[Sequence[Energies | None]]) -> None:
        """Look at the steps of an earlier run that this one goes on from; what it found is told."""
        for sides in earlier:
            self.look(sides)
