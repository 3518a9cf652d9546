"""Conditions on the faces of the domain: their form, and what each of them takes.

A new condition is a name in ``ConditionName``, a row in ``CONDITIONS``, and a class in
``gimpmd_gimp.boundary``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from gimpmd_schemas.case.base import Pair, Timed
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.profiles import Value, components

ConditionName = Literal[
    "free", "traction", "velocity", "displacement", "symmetry", "absorbing", "foundation"
]


@dataclass(frozen=True)
class Takes:
    """What belongs to a condition.

    Attributes
    ----------
    value : bool
        Whether it needs the components of a value.
    stiffness : bool
        Whether it needs a stiffness, which does not change with time.
    from_zero : bool
        Whether its time function must be zero at the start.
    atoms : bool
        Whether atoms may lie on the face.
    """

    value: bool = False
    stiffness: bool = False
    from_zero: bool = False
    atoms: bool = False


CONDITIONS: Mapping[ConditionName, Takes] = {
    "free": Takes(atoms=True),
    "traction": Takes(value=True, atoms=True),
    "velocity": Takes(value=True, atoms=True),
    "displacement": Takes(value=True, from_zero=True, atoms=True),
    "symmetry": Takes(atoms=True),
    "absorbing": Takes(),
    "foundation": Takes(stiffness=True),
}
"""What each condition takes."""


def names_of(what: str) -> str:
    """Conditions that have a field of `Takes`, as words of a sentence."""
    *first, last = (name for name, takes in CONDITIONS.items() if getattr(takes, what))
    return f"{', '.join(first)} or {last}" if first else last


class Face(Timed, frozen=True):
    """Condition on a face of the domain, or on a part of it.

    Attributes
    ----------
    condition : ``free``, ``traction`` (value: force per length or area, global components,
        pressure units), ``velocity`` or ``displacement`` (value: components, ``null`` leaves one
        free), ``symmetry`` (no normal motion), ``absorbing`` (viscous, lets waves out) or
        ``foundation`` (elastic: traction ``-stiffness`` times the displacement of the face).
    value : components of the traction, velocity or displacement, or a profile: a function of
        position (`profiles`).
    stiffness : of a foundation (pressure units per length).
    ramp : time over which the value grows linearly from zero.
    history : in place of a ramp, ``[[time, factor], ...]``: linear between the times, constant
        before and after.
    extent : of a part of a face, ``[[low, high], ...]`` along the other axes in their order,
        half-open; empty: all of the face.
    """

    condition: ConditionName = "free"
    value: Value = ()
    stiffness: float | None = None
    extent: tuple[Pair, ...] = ()


def check_face(face: Face, key: str, dim: int, periodic: bool, rules: Rules) -> None:
    """Check that a condition has what it takes, and nothing else.

    Parameters
    ----------
    key : str
        Key of the face in the case file.
    dim : int
        Number of dimensions.
    periodic : bool
        Whether the body is periodic along the normal of the face.
    """
    takes = CONDITIONS[face.condition]
    face.check_time(key, rules)
    given = [v for v in components(face.value) if v is not None]
    rules.require(
        not takes.value or bool(given),
        f"{key}.value",
        None,
        f"a {face.condition} needs a value",
        f"write {dim} components, for example {[0, 0.3, 0][:dim]}",
    )
    rules.require(
        takes.value or not given,
        f"{key}.value",
        face.value,
        f"a {face.condition} face takes no value",
        f"leave it out, or set condition: {names_of('value')}",
    )
    rules.require(
        not (periodic and face.condition != "free"),
        f"{key}.condition",
        face.condition,
        "belongs to a periodic axis, which has no face",
        "leave it out",
    )
    _check_stiffness(face, key, rules)
    if not isinstance(face.value, tuple):
        face.value.check(f"{key}.value", face.condition, rules)
    rules.require(
        not takes.from_zero or face.factor(0.0) == 0.0,
        key,
        face.factor(0.0),
        f"the factor of a {face.condition} must be zero at the start",
        "give it a ramp, or a history that starts with [0, 0]",
    )


def _check_stiffness(face: Face, key: str, rules: Rules) -> None:
    if not CONDITIONS[face.condition].stiffness:
        rules.require(
            face.stiffness is None,
            f"{key}.stiffness",
            face.stiffness,
            f"a {face.condition} face has no stiffness",
            f"leave it out, or set condition: {names_of('stiffness')}",
        )
        return
    rules.require(
        face.stiffness is not None and face.stiffness > 0.0,
        f"{key}.stiffness",
        face.stiffness,
        f"a {face.condition} needs a positive stiffness",
        "write the pressure per displacement of the face, for example 0.1",
    )
    rules.require(
        face.ramp == 0.0 and not face.history,
        f"{key}.ramp",
        face.ramp,
        f"the stiffness of a {face.condition} does not change with time",
        "leave ramp and history out",
    )
