"""A small recording for tests: two ranks of the MD side, one of the continuum, velocity scheme."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Array,
    Payload,
    Register,
    Report,
    StepReport,
    encode,
)
from gimpmd_schemas.wire.recording import Member

OFFERS: Mapping[Member, Array] = {
    ("md", 0): np.array([1, 2, 3]),
    ("md", 1): np.array([4, 5]),
    ("continuum", 0): np.array([7, 8]),
}
NEEDS: Mapping[Member, Array] = {
    ("md", 0): np.array([8]),
    ("md", 1): np.array([8, 7]),
    ("continuum", 0): np.array([5, 3, 1, 4]),
}


def register(member: Member) -> bytes:
    """Registration of a rank."""
    role, rank = member
    message = Register(
        protocol=PROTOCOL_VERSION,
        run="test",
        plan="0",
        role=role,
        rank=rank,
        ranks=2 if role == "md" else 1,
        backend="fake 1",
        units="lj",
        dt=0.1,
        patch=((0.0, 1.0), (0.0, 1.0)),
        host="here",
        pid=1,
        notes=("a note",),
    )
    return encode(message, {"offers": OFFERS[member], "needs": NEEDS[member]})


def fields(member: Member, step: int) -> dict[str, Array]:
    """Fields of a rank; no two values are equal."""
    role, _ = member
    nodes = OFFERS[member] + 100.0 * step
    velocity = np.stack([nodes, -nodes], axis=1)
    return {"mass": nodes + 0.5, "velocity": velocity} if role == "md" else {"velocity": velocity}


def payload(member: Member, step: int) -> bytes:
    """Payload of a rank."""
    role, rank = member
    return encode(Payload(role=role, rank=rank, step=step), fields(member, step))


def energies(step: int) -> Energies:
    """Energies at a step."""
    rest = {"external_work": 0.0, "interface_work": 0.0, "dissipated": 0.0, "mass": 1.0}
    return Energies(kinetic=float(step), potential=0.0, momentum=(0.0, 0.0), **rest)


def report(member: Member, step: int) -> bytes:
    """Report of a rank with its energies at a step."""
    role: Role
    role, rank = member
    one = StepReport(step=step, energies=energies(step), timings={})
    return encode(Report(role=role, rank=rank, steps=(one,), peak_memory=0))


def write(path: Path, last: int, *more: bytes) -> None:
    """Write a recording of the steps from 0 to a last one, with energies at even steps."""
    frames = [register(member) for member in OFFERS]
    for step in range(last + 1):
        if step % 2 == 0:
            frames += [report(member, step) for member in OFFERS]
        frames += [payload(member, step) for member in sorted(OFFERS)]
    path.write_bytes(b"".join([*frames, *more]))
