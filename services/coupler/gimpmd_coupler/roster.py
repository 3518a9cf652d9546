"""The roster: which ranks belong to the run, and which of them have registered. Pure logic."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gimpmd_coupler.grants import name
from gimpmd_coupler.mapping import Link, check_ids, links
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import ProtocolError, RefusedError
from gimpmd_schemas.wire.messages import PROTOCOL_VERSION, Array, Member, Register, Report

_OTHER: Mapping[Role, Role] = {"md": "continuum", "continuum": "md"}


@dataclass(frozen=True)
class Entry:
    """A registered rank: its message, and the nodes that it offers and needs."""

    register: Register
    offers: Ints
    needs: Ints


class Roster:
    """Collects registrations and compares them with the plan of the run."""

    def __init__(self, run: str, plan: Plan, first_step: int = 0) -> None:
        self._run, self._first_step = run, first_step
        self._plan = plan
        self._digest = plan.digest()
        self.ranks: dict[Role, int] = {role: plan.ranks(role) for role in plan.roles}
        self.expected: tuple[Member, ...] = tuple(
            (role, rank) for role, count in self.ranks.items() for rank in range(count)
        )
        self.entries: dict[Member, Entry] = {}

    def enter(self, register: Register, arrays: Mapping[str, Array]) -> Member:
        """Register a rank. A repeated registration changes nothing.

        Raises
        ------
        RefusedError
            The rank does not belong to this run; the message gives both values.
        ProtocolError
            The node lists are malformed.
        """
        self._compare(register)
        member: Member = (register.role, register.rank)
        known = self.entries.get(member)
        if known is not None and known.register != register:
            raise RefusedError(
                f"{name(member)} is already taken by process {known.register.pid} on"
                f" {known.register.host}; this is process {register.pid} on {register.host}"
            )
        offers, needs = (
            check_ids(name(member), kind, arrays.get(kind)) for kind in ("offers", "needs")
        )
        self.entries[member] = Entry(register, offers, needs)
        return member

    def missing(self) -> list[Member]:
        """Ranks that have not registered yet."""
        return [member for member in self.expected if member not in self.entries]

    def check_report(self, message: Report) -> Member:
        """Return the rank that sent a report.

        Raises
        ------
        RefusedError
            It has not registered.
        ProtocolError
            A momentum has the wrong number of components.
        """
        member: Member = (message.role, message.rank)
        if member not in self.entries:
            raise RefusedError(f"{name(member)} reports before it has registered")
        dim = self._plan.dim
        for report in message.steps:
            if report.energies is not None and len(report.energies.momentum) != dim:
                raise ProtocolError(
                    f"{name(member)} reports a momentum with {len(report.energies.momentum)}"
                    f" components; the run has {dim} dimensions"
                )
        return member

    def links(self, member: Member) -> dict[int, Link]:
        """Find from which ranks of the other side a rank takes the nodes that it needs.

        Raises
        ------
        ProtocolError
            A needed node is not offered, or offered more than once.
        """
        other = _OTHER[member[0]]
        if other not in self.ranks:
            return {}
        offers = {rank: self.entries[other, rank].offers for rank in range(self.ranks[other])}
        return links(name(member), self.entries[member].needs, offers, other)

    def _compare(self, register: Register) -> None:
        """Compare a registration with the plan, the most informative difference first."""
        _same("protocol version", PROTOCOL_VERSION, register.protocol)
        _same("run id", self._run, register.run)
        role, rank = register.role, register.rank
        if role not in self._plan.roles:
            raise RefusedError(f"role {role!r} has no part in a run of {self._plan.only!r} only")
        _same(f"number of {role} ranks", self._plan.ranks(role), register.ranks)
        if (role, rank) not in self.expected:
            raise RefusedError(
                f"rank {rank} of {role} is out of range: ranks 0 to {register.ranks - 1} take part"
            )
        _same("unit style", self._plan.units, register.units)
        _same("coupling time step", self._plan.step, register.dt)
        _same("plan digest", self._digest, register.plan)
        _same("step of the checkpoint to go on from", self._first_step, register.first_step)


def _same(what: str, ours: object, theirs: object) -> None:
    if ours != theirs:
        raise RefusedError(f"{what} differs: the coupler has {ours!r}, the service {theirs!r}")
