"""What acts on a case: conditions on the faces, body force, damping, initial state."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.conditions import CONDITIONS, Face, check_face, names_of
from gimpmd_schemas.case.derive.material import stiffness
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import FACES, Case, Packet, Stretch
from gimpmd_schemas.case.materials import MeasuredByMd, is_isotropic
from gimpmd_schemas.case.profiles import KField
from gimpmd_schemas.mechanics.elasticity import christoffel, keeps_in_plane

MAX_TILT = 80.0
"""Largest angle between a wave and its axis (degrees)."""

MAX_PARTS = 16
"""Largest number of parts of faces with a condition, where there are atoms.

LAMMPS has 32 groups, and each part takes one.
"""

MAX_STRETCH = 0.2
"""Largest accepted displacement gradient at the start; a crystal would break."""


def check_faces(case: Case, rules: Rules) -> None:
    """Check the conditions on the faces: they have values where needed and nowhere else."""
    for index, name in enumerate(FACES):
        axis, side = divmod(index, 2)
        parts = case.boundary.parts(axis, side)
        if axis >= case.dim:
            rules.require(
                list(parts.values()) == [Face()],
                f"boundary.{name}",
                [face.condition for face in parts.values()],
                f"a body of two dimensions has no {name} face",
                "leave it out, or give domain.box a third pair",
            )
            continue
        for key, face in parts.items():
            _check_part(case, axis, side, key, face, rules)
        _check_overlaps(parts, rules)
    _check_number(case, rules)


def _check_part(case: Case, axis: int, side: int, key: str, face: Face, rules: Rules) -> None:
    """Check the condition on a part of a face, and its extent."""
    check_face(face, key, case.dim, case.domain.periodic[axis], rules)
    _check_extent(case, axis, key, face, rules)
    measured = isinstance(case.continuum.material, MeasuredByMd)  # isotropic, or refused later
    if isinstance(face.value, KField) and not measured:
        C = stiffness(case)
        rules.require(
            abs(C[0, 0] - C[0, 1] - 2.0 * C[-1, -1]) < 1e-3 * C[0, 0],
            f"{key}.value.profile",
            "k-field",
            "is the field of an isotropic material, which this one is not",
            "use an isotropic material",
        )
    if not CONDITIONS[face.condition].atoms and case.only != "continuum":
        rules.require(
            all(region.interfaces[axis][side] for region in zones(case).regions),
            f"{key}.condition",
            face.condition,
            "is not available for the atoms, whose region ends on this face",
            f"move md.region off the face, or use {names_of('atoms')}",
        )


def _check_extent(case: Case, axis: int, key: str, face: Face, rules: Rules) -> None:
    """Check that the extent of a part lies on its face."""
    part = key.endswith("]")
    rules.require(
        part == bool(face.extent),
        f"{key}.extent",
        face.extent or None,
        "is missing" if part else "is given, but the face has one condition",
        "give each part of the list its extent"
        if part
        else "write the conditions of the face as a list: - {condition: ..., extent: ...}",
    )
    others = [other for other in range(case.dim) if other != axis]
    if not face.extent or not rules.require(
        len(face.extent) == len(others),
        f"{key}.extent",
        face.extent,
        f"must have {len(others)} pair{'s' if len(others) > 1 else ''}: the extent along "
        f"{' and '.join(AXES[other] for other in others)}",
        "write [[low, high]]" if case.dim == 2 else "write [[low, high], [low, high]]",
    ):
        return
    for other, (low, high) in zip(others, face.extent, strict=True):
        start, end = case.domain.box[other]
        rules.require(
            start <= low < high <= end,
            f"{key}.extent",
            face.extent,
            f"does not lie on the face, which extends from {start:g} to {end:g} along "
            f"{AXES[other]}",
            "write [low, high] within these limits, low first",
        )


def _check_overlaps(parts: dict[str, Face], rules: Rules) -> None:
    """Check that no two parts of a face overlap."""
    for (one, first), (other, second) in combinations(parts.items(), 2):
        rules.require(
            any(
                high <= start or end <= low
                for (low, high), (start, end) in zip(first.extent, second.extent, strict=False)
            ),
            f"{other}.extent",
            second.extent,
            f"overlaps {one}, whose extent is {list(map(list, first.extent))}",
            "let each part begin where the other ends",
        )


def _check_number(case: Case, rules: Rules) -> None:
    """Check that the atoms have a role bit for each part."""
    keys = [
        key
        for index in range(2 * case.dim)
        for key, face in case.boundary.parts(*divmod(index, 2)).items()
        if face.condition != "free"
    ]
    rules.require(
        len(keys) <= MAX_PARTS or case.only == "continuum",
        "boundary",
        len(keys),
        f"are too many parts with a condition: at most {MAX_PARTS} where there are atoms",
        "join parts, or use a profile",
    )


def check_body_force(case: Case, rules: Rules) -> None:
    """Check the body force, which acts on the continuum only."""
    force, key = case.continuum.body_force, "continuum.body_force"
    if force is None:
        return
    force.check_time(key, rules)
    rules.require(
        case.only == "continuum",
        key,
        force.acceleration,
        "acts on the continuum only; the atoms would not feel it",
        "write only: continuum, or run with --only continuum",
    )


def check_damping(case: Case, rules: Rules) -> None:
    """Check rates, shares of FLIP and boxes of the damped regions."""
    for index, damping in enumerate(case.continuum.damping):
        key = f"continuum.damping[{index}]"
        rules.require(damping.rate >= 0, f"{key}.rate", damping.rate, "must not be negative")
        rules.require(
            damping.flip is None or 0.0 <= damping.flip <= 1.0,
            f"{key}.flip",
            damping.flip,
            "must be a fraction between 0 (PIC) and 1 (FLIP)",
        )
        _check_upright(damping.box, f"{key}.box", rules)


def check_initial(case: Case, rules: Rules) -> None:
    """Check packets, stretch and velocity fields at the start."""
    for index, packet in enumerate(case.initial.packets):
        key = f"initial.packets[{index}]"
        rules.require(
            packet.wavelength > 0, f"{key}.wavelength", packet.wavelength, "must be positive"
        )
        rules.require(packet.cycles > 0, f"{key}.cycles", packet.cycles, "must be positive")
        if not rules.require(
            packet.axis < case.dim,
            f"{key}.axis",
            packet.axis,
            "a body of two dimensions has no z axis",
            "write 0 or 1",
        ):
            continue
        low, high = case.domain.box[packet.axis]
        rules.require(
            low <= packet.center <= high,
            f"{key}.center",
            packet.center,
            "is outside the domain",
            f"the domain is [{low:g}, {high:g}] along {AXES[packet.axis]}",
        )
        if packet.tilt != 0.0:
            _check_tilt(case, packet, f"{key}.tilt", rules)
        elif not isinstance(case.continuum.material, MeasuredByMd) and not is_isotropic(
            case.continuum.material
        ):
            tensor = christoffel(stiffness(case), packet.axis)
            i = packet.component(case.dim)
            rules.require(
                float(np.abs(np.delete(tensor[i], i)).max()) <= 1e-9 * tensor[i, i],
                f"{key}.polarization",
                packet.polarization,
                f"is not a wave of this stiffness along {AXES[packet.axis]}: its motion would not "
                f"stay along {AXES[i]}",
                "choose another axis or polarization, or use initial.velocities",
            )
    if case.initial.stretch is not None:
        _check_stretch(case, case.initial.stretch, rules)
    for index, field in enumerate(case.initial.velocities):
        key = f"initial.velocities[{index}]"
        _check_upright(field.box, f"{key}.box", rules)
        rules.require(
            field.center is None or field.gradient is not None,
            f"{key}.center",
            field.center,
            "has no effect without a gradient",
            "leave it out, or give the gradient",
        )


def _check_stretch(case: Case, stretch: Stretch, rules: Rules) -> None:
    """Check that the stretch is small, and that there is none along a periodic axis."""
    G = np.array(stretch.gradient)
    rules.require(
        float(np.abs(G).max()) < MAX_STRETCH,
        "initial.stretch.gradient",
        stretch.gradient,
        f"must be less than {MAX_STRETCH:g}",
    )
    for axis, name in enumerate(AXES[: case.dim]):
        rules.require(
            not case.domain.periodic[axis] or not G[:, axis].any(),
            "initial.stretch.gradient",
            stretch.gradient,
            f"displaces one end of the period along {name} relative to the other",
            f"set its column {axis + 1} to zero",
        )


def _check_tilt(case: Case, packet: Packet, key: str, rules: Rules) -> None:
    """Check a tilted wave: modes move in its plane, and whole waves fit a periodic width."""
    if case.dim == 3 and not isinstance(case.continuum.material, MeasuredByMd):
        across = (packet.axis + 1) % 3
        rules.require(
            keeps_in_plane(stiffness(case), packet.axis, across),
            key,
            packet.tilt,
            f"needs waves that move in the plane of {AXES[packet.axis]} and {AXES[across]} or "
            "normal to it, as in a mirror plane; this stiffness couples both",
            "leave it out, or choose another axis",
        )
    if not rules.require(
        abs(packet.tilt) <= MAX_TILT,
        key,
        packet.tilt,
        f"must lie between {-MAX_TILT:g} and {MAX_TILT:g} degrees",
        "choose the other axis",
    ):
        return
    across = (packet.axis + 1) % case.dim
    low, high = case.domain.box[across]
    waves = (high - low) * math.sin(math.radians(packet.tilt)) / packet.wavelength
    fits = [
        math.degrees(math.asin(number * packet.wavelength / (high - low)))
        for number in (math.floor(waves), math.ceil(waves))
        if abs(number * packet.wavelength) < high - low
    ]
    rules.require(
        not case.domain.periodic[across] or abs(waves - round(waves)) < 1e-6,
        key,
        packet.tilt,
        f"gives {waves:.6g} waves over the period along {AXES[across]}, not a whole number",
        f"these fit: {' and '.join(f'{angle:.9g}' for angle in fits)}",
    )


def _check_upright(box: tuple[tuple[float, float], ...] | None, key: str, rules: Rules) -> None:
    for name, (low, high) in zip(AXES, box or (), strict=False):
        rules.require(
            high > low,
            key,
            box,
            f"upper {name} is not above lower {name}",
            f"write {name} as [lower, upper]",
        )
