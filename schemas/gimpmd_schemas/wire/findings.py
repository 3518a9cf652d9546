"""Findings: what monitors say of a run whose results cannot be trusted.

Every side has *monitors*: values that stay within a limit in a sound run. A value beyond its limit
is a *finding*. A rank reports its findings with the step at which it made them. The coupler, which
knows both sides, has a monitor of the whole body. The user reads the first finding of each kind on
each side.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import msgspec

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan

Kind = Literal[
    "broken bond",
    "overlap",
    "atoms",
    "mass",
    "speed",
    "energy",
    "initial energy",
    "strain",
    "stiffness",
    "short waves",
    "total energy",
]

Side = Role | Literal["body"]
"""What a finding is about: a side, or the whole body."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A value of a monitor beyond its limit, on one rank at one step.

    Attributes
    ----------
    kind : which monitor.
    value : the value that it found.
    limit : the largest value that it accepts.
    place : present position (length), one coordinate for each axis; null: the whole side.
    """

    kind: Kind
    value: float
    limit: float
    place: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Monitor:
    """How the finding of a monitor is told.

    Attributes
    ----------
    value : what the value is.
    meaning : what a value beyond the limit says of the run.
    cure : what the user can do.
    """

    value: str
    meaning: str
    cure: str


FURTHER = "move the faces of the MD region further from the defect"

MONITORS: dict[Kind, Monitor] = {
    "broken bond": Monitor(
        "stretch of a bond between neighbouring atoms",
        "a defect of the crystal has reached the interface: bonds between neighbouring atoms are "
        "broken there, but the continuum beyond remains a perfect crystal",
        FURTHER,
    ),
    "overlap": Monitor(
        "length at rest over present length of a pair of atoms",
        "a defect of the crystal has reached the interface: atoms are close to each other that are "
        "not in a perfect crystal, such as the continuum beyond",
        FURTHER,
    ),
    "atoms": Monitor(
        "number of atoms lost or added",
        "the number of atoms has changed since the script of md.input made them",
        "do not delete or create atoms in md.after or by a fix; make the atoms in md.input",
    ),
    "mass": Monitor(
        "relative change of the mass",
        "the mass of this side has changed",
        "atoms or material points have been lost; see the log of this side",
    ),
    "speed": Monitor(
        "speed (rms, about the mean velocity) over the speed of sound",
        "this side moves faster than a solid body can",
        "lower the loads, the initial velocities or the temperature of a thermostat, or take "
        "shorter time steps",
    ),
    "energy": Monitor(
        "energy without a source over the energy that the case explains",
        "this side has gained energy that no initial state, load, fix or interface explains",
        "take shorter time steps, or move fixes from md.input to md.after, where their work is "
        "measured",
    ),
    "initial energy": Monitor(
        "potential energy over that of the atoms at a strain of 3 %, at the start",
        "the atoms have potential energy at the start that the initial state does not explain",
        "do not change the potential or displace atoms in md.after",
    ),
    "strain": Monitor(
        "norm of the strain of a material point",
        "a material point is strained beyond the reach of its law",
        "make the MD region larger, so that it contains what strains the body so much, or choose a "
        "law with a further reach: from: md and model: cauchy-born",
    ),
    "stiffness": Monitor(
        "difference of the stiffness from that of the crystal, relative",
        "the continuum is another material than the crystal that it meets at the planes",
        "let LAMMPS measure the material (from: md) with the potential of md.input",
    ),
    "short waves": Monitor(
        "share of short waves in the kinetic energy of the atoms near the planes",
        "much of the motion near the planes is in waves too short for the grid, which the planes "
        "reflect",
        "use smaller cells, or an absorber (coupling.absorber)",
    ),
    "total energy": Monitor(
        "energy without a source over the energy that the case explains",
        "the atoms and the continuum together have gained energy that no initial state, load, fix "
        "or damping explains",
        "move fixes from md.input to md.after, where their work is measured; if there are none, "
        "use coupling.scheme: force or sites, which conserve energy, or take shorter time steps",
    ),
}
"""How findings are told, by kind."""

STEPS_APART, MD_STEPS_APART = 20, 600
"""Least number of coupling steps, and of MD steps, between two looks of the monitors.

A look takes as long as half of an MD step to two MD steps (docs/monitors.md, Cost)."""

SIDES: dict[Side, str] = {"md": "atoms", "continuum": "continuum", "body": "whole body"}


def sentence(side: Side, finding: Finding, time: float) -> str:
    """Tell the user what a monitor found.

    Parameters
    ----------
    side : {'md', 'continuum', 'body'}
        What the finding is about.
    finding : Finding
        The first one of its kind on this side.
    time : float
        When it was made.
    """
    monitor = MONITORS[finding.kind]
    near = ""
    if finding.place is not None:
        near = f", near ({', '.join(f'{x:.5g}' for x in finding.place)})"
    return (
        f"{SIDES[side]}, t = {time:.6g}{near}: {monitor.meaning} ({monitor.value}: "
        f"{finding.value:.4g}, limit {finding.limit:.4g}); the results are not reliable from here "
        f"on; {monitor.cure}"
    )


def check(
    kind: Kind, value: float, limit: float, place: Iterable[float] | None = None
) -> tuple[Finding, ...]:
    """Return the finding if a value is beyond its limit or not a number, otherwise nothing.

    Messages hold finite numbers only, so a value that is not finite becomes the largest one.
    """
    if value <= limit:
        return ()
    finite = value if math.isfinite(value) else sys.float_info.max
    where = None if place is None else tuple(float(x) for x in place)
    return (Finding(kind=kind, value=finite, limit=limit, place=where),)


def monitors_look(plan: Plan, step: int) -> bool:
    """Whether monitors look at a coupling step; only if it is one with energies.

    They look at the start, at the end, and seldom enough to cost next to nothing: what they find
    leaves traces that stay.
    """
    md_steps = plan.md.steps if plan.md else MD_STEPS_APART
    apart = max(STEPS_APART, math.ceil(MD_STEPS_APART / md_steps))
    stride = plan.energies_every * math.ceil(apart / plan.energies_every)
    return step % stride == 0 or step == plan.steps


def worst(findings: Iterable[Finding]) -> list[Finding]:
    """Return the finding of each kind that is furthest beyond its limit.

    The order is that of `Kind`, and does not depend on the order of the ranks.
    """
    found: dict[Kind, Finding] = {}
    for finding in findings:
        best = found.get(finding.kind)
        if best is None or finding.value > best.value:
            found[finding.kind] = finding
    return [found[kind] for kind in get_args(Kind) if kind in found]
