"""The table of fields: every quantity that services send, with its shape, unit and sender.

Coupler, recorder, services and documentation all read this table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from gimpmd_schemas.case.form import AT_PLANES, Role, SchemeName
from gimpmd_schemas.mechanics.units import Units

Sender = Literal["md", "continuum", "coupler"]

_ALL: tuple[SchemeName, ...] = get_args(SchemeName)
_ZONES: tuple[SchemeName, ...] = ("velocity", "paper")
_BOTH: Mapping[Sender, tuple[SchemeName, ...]] = {"md": _ALL, "continuum": _ALL}
_COUPLER: Mapping[Sender, tuple[SchemeName, ...]] = {"coupler": _ALL}


@dataclass(frozen=True)
class Field:
    """One quantity.

    Attributes
    ----------
    name : name in messages, and of the data set in ``run.h5``.
    rank : tensor rank: 0 for a scalar, 1 for a vector with one component for each axis.
    unit : unit, with ``{mass}``, ``{length}``, ``{time}`` and ``{energy}`` of the unit style.
    meaning : what it is.
    senders : who sends it, and under which coupling schemes.
    """

    name: str
    rank: int
    unit: str
    meaning: str
    senders: Mapping[Sender, tuple[SchemeName, ...]]

    def shape(self, dim: int) -> tuple[int, ...]:
        """Shape of one value in ``dim`` dimensions."""
        return (dim,) * self.rank

    def components(self, dim: int) -> tuple[str, ...]:
        """Names of its components: ``mass``, or ``momentum_x``, ``momentum_y``, ..."""
        if self.rank == 0:
            return (self.name,)
        return tuple(f"{self.name}_{axis}" for axis in "xyz"[:dim])

    def unit_in(self, units: Units) -> str:
        """Unit in a unit style, such as ``eV``."""
        names = {"mass": units.mass, "length": units.length, "time": units.time}
        return self.unit.format(energy=units.energy, **names)


ZONE_FIELDS = (
    Field("mass", 0, "{mass}", "nodal mass", {"md": _ZONES}),
    Field(
        "velocity",
        1,
        "{length}/{time}",
        "nodal velocity",
        {"md": _ZONES, "continuum": _ALL},
    ),
    Field(
        "force",
        1,
        "{mass} {length}/{time}^2",
        "force of the ghost atoms on the nodes",
        {"md": AT_PLANES},
    ),
)
"""Fields on nodes of the background grid, which the two sides exchange at every step."""

ENERGY_FIELDS = (
    Field("kinetic", 0, "{energy}", "kinetic energy", _BOTH),
    Field("potential", 0, "{energy}", "potential energy relative to the reference state", _BOTH),
    Field(
        "external_work",
        0,
        "{energy}",
        "work of tractions and prescribed velocities since the start",
        _BOTH,
    ),
    Field(
        "fix_work",
        0,
        "{energy}",
        "work of the user's own fixes (md.after) since the start",
        _BOTH,
    ),
    Field(
        "interface_work",
        0,
        "{energy}",
        "work that the other side has done on this side since the start",
        _BOTH,
    ),
    Field(
        "dissipated",
        0,
        "{energy}",
        "energy turned into heat by friction, filter or absorber since the start",
        _BOTH,
    ),
    Field("mass", 0, "{mass}", "mass", _BOTH),
    Field("momentum", 1, "{mass} {length}/{time}", "linear momentum", _BOTH),
)
"""What each side reports at the steps that have energies: the components of ``Energies``."""

TOTAL_FIELDS = (
    Field("energy", 0, "{energy}", "kinetic and potential energy of both sides", _COUPLER),
    Field("external_work", 0, "{energy}", "work done on both sides since the start", _COUPLER),
    Field("fix_work", 0, "{energy}", "work of the user's own fixes since the start", _COUPLER),
    Field("dissipated", 0, "{energy}", "energy turned into heat since the start", _COUPLER),
    Field("balance", 0, "1", "energy balance, (W - D - (E - E0)) / max(|W|, |E0|)", _COUPLER),
)
"""What the coupler's ledger computes of the whole body."""

STEP_FIELDS = (
    Field("step", 0, "1", "coupling step", _COUPLER),
    Field("time", 0, "{time}", "time of the coupling step", _COUPLER),
)
"""What places a row of ``run.h5`` in time."""


def sent_fields(role: Role, scheme: SchemeName) -> tuple[Field, ...]:
    """Zone fields that a role sends under a coupling scheme."""
    return tuple(field for field in ZONE_FIELDS if scheme in field.senders.get(role, ()))
