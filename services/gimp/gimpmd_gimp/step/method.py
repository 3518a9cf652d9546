"""How a step is taken: integrator, interpolation, configuration, filters."""

from __future__ import annotations

from dataclasses import dataclass

from gimpmd_gimp.grid.clock import Integrator
from gimpmd_gimp.points.body import Interpolation, Placement
from gimpmd_gimp.points.material_points import Configuration
from gimpmd_gimp.step.damping import DampingRegion


@dataclass(frozen=True)
class Method:
    """How a step is taken.

    Attributes
    ----------
    integrator : when points deform (``integrators.py``).
    interpolation : weights of the points. ``cpgimp`` stretches the domains of the points with F,
        which has no meaning in the reference configuration.
    xpic_order, xpic_every : order of the XPIC filter, which removes the null space of FLIP, and
        the steps between two uses (0: never). The filter never acts in the reference configuration:
        weights that do not change will never see what they cannot see now.
    damping : regions of decay and of PIC.
    configuration : where points stand on the grid.
    dispersion : strength beta of the dispersion correction (``dispersion.py``), 0 for none. It
        needs MUSL, the reference configuration, and ``ugimp`` or ``linear``.

    Raises
    ------
    ValueError
        The choices do not fit together.
    """

    integrator: Integrator = "usavg"
    interpolation: Interpolation = "ugimp"
    xpic_order: int = 5
    xpic_every: int = 20
    damping: tuple[DampingRegion, ...] = ()
    configuration: Configuration = "current"
    dispersion: float = 0.0

    def __post_init__(self) -> None:
        reference = self.configuration == "reference"
        if reference and self.interpolation == "cpgimp":
            raise ValueError("points do not stretch in the reference configuration: use ugimp")
        if self.dispersion < 0.0:
            raise ValueError(f"the dispersion correction {self.dispersion:g} is negative")
        fits = reference and self.integrator == "musl" and self.interpolation in ("ugimp", "linear")
        if self.dispersion > 0.0 and not fits:
            raise ValueError(
                "the dispersion correction needs the reference configuration, MUSL, and ugimp or "
                f"linear; this is {self.configuration}, {self.integrator}, {self.interpolation}"
            )

    @property
    def placement(self) -> Placement:
        """How the points lie on the grid."""
        return Placement(self.configuration, self.interpolation, self.dispersion > 0.0)
