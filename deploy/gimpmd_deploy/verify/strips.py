"""Strips of the user's crystal: continuum on one side, atoms on the other, and a wave packet.

A strip is periodic across its length. The packet starts three and a half standard deviations before
the interface and ends as far behind it. In schemes with planes the interface is the first plane,
which lies some cells inside the region of atoms. Lengths in "cells" are in cells of the strip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec

from gimpmd_schemas.case import materials
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.derive import levels, times
from gimpmd_schemas.case.derive.material import material
from gimpmd_schemas.case.form import (
    FACES,
    Boundary,
    Case,
    Continuum,
    Coupling,
    Domain,
    Grid,
    Initial,
    Md,
    Output,
    Packet,
    Time,
)
from gimpmd_schemas.wire.answers import Repeat

Travel = Literal["into", "out"]
"""From the continuum into the atoms, or out of the atoms."""
Axis = Literal[0, 1, 2]

SCRIPT = "strip.in"
REACH = 2.5
"""Half-length (wavelengths) of a packet of two cycles; all but 4e-5 of its energy lies within."""
MARGIN = 8.0
"""Extra cells before and behind a packet: waves on a grid are slower than in the material."""
STRAIN = 2e-4
"""Amplitude of the strain: small enough for any crystal to be linear."""
MISFIT = 0.04
"""Largest fraction by which cells of a strip are smaller than those of the case."""
NARROWEST, WIDEST = 2, 24
"""Cells across a strip for straight waves."""
SAME = 1e-6
"""Fraction of a period by which the width of a strip may miss a whole number of periods."""
KEPT = 1e-7
"""Distance (cells) outside a face within which atoms are still kept."""


@dataclass(frozen=True)
class Wave:
    """A plane wave.

    Attributes
    ----------
    wavelength : in cells of the strip.
    polarization : ``P`` or ``S``.
    degrees : angle between the direction of travel and the normal of the interface.
    """

    wavelength: float
    polarization: Literal["P", "S"] = "P"
    degrees: float = 0.0

    @property
    def label(self) -> str:
        """Name, unique among the waves of a verification."""
        tilt = f"-{self.degrees:.1f}deg" if self.degrees else ""
        return f"{self.polarization}-{self.wavelength:g}h{tilt}"


@dataclass(frozen=True)
class Ground:
    """A case, its crystal, and how strips are cut from it.

    Attributes
    ----------
    case : gives the strips their material, coupling, time steps and integration.
    script : LAMMPS script that creates a periodic cell of the crystal.
    crystal : how that cell repeats.
    axis : normal of the interface.
    cell : edge of the cells, slightly smaller than those of the case if the strip must fit.
    across : numbers of cells across the narrowest strip, along the other axes in cyclic order.
    depth : distance (cells) of the first plane from the end of the region of atoms; 0 in schemes
        without planes.
    """

    case: Case
    script: str
    crystal: Repeat
    axis: Axis
    cell: float
    across: tuple[int, ...]
    depth: float = 0.0

    @classmethod
    def of(cls, case: Case, script: str, crystal: Repeat, axis: Axis = 0) -> Ground:
        """Choose a cell such that whole numbers of cells span whole periods of the crystal.

        Raises
        ------
        ValueError
            No cell fits all periods across the strip.
        """
        h = levels.finest_cell(case)
        periods = [crystal.period[k] for k in _others(axis, case.dim)]
        cell, across = fitted(h, periods)
        return cls(case, script, crystal, axis, cell, across, _depth(case, axis) / cell)

    def oblique(self, wavelength: float, polarization: Literal["P", "S"], degrees: float) -> Wave:
        """Return the wave nearest to an angle that is periodic across some strip."""
        narrowest = self.across[0]
        strips = max(1, round(wavelength / math.sin(math.radians(degrees)) / narrowest))
        strips = max(strips, math.ceil((wavelength + 1e-9) / narrowest))
        angle = math.degrees(math.asin(wavelength / (strips * narrowest)))
        return Wave(wavelength, polarization, angle)

    def strip(self, wave: Wave, travel: Travel) -> Case:
        """Return the case of a packet that crosses the interface; below it is the continuum."""
        h, axis, case, dim = self.cell, self.axis, self.case, self.case.dim
        reach = REACH * wave.wavelength
        cells = math.ceil(2.0 * reach + MARGIN)
        across = list(self.across)
        if wave.degrees:
            across[0] = round(wave.wavelength / math.sin(math.radians(wave.degrees)))
        box = [(low, low) for low in self.crystal.low[:dim]]
        for k, count in zip(_others(axis, dim), across, strict=True):
            box[k] = (box[k][0], box[k][0] + count * h)
        start = box[axis][0]
        interface, end = start + cells * h, start + 2 * cells * h
        box[axis] = (start, end)
        atoms = [*box]
        atoms[axis] = (interface - self.depth * h, end)
        packet = Packet(
            center=interface + (-reach if travel == "into" else reach) * h,
            wavelength=wave.wavelength * h,
            strain=STRAIN,
            axis=axis,
            direction=1 if travel == "into" else -1,
            polarization=wave.polarization,
            tilt=wave.degrees,
        )
        speed = _speed(case, packet) * math.cos(math.radians(wave.degrees))
        steps = math.ceil((2.0 * reach + MARGIN) * h / speed / times.step(case))
        held = Face(condition="velocity", value=(0.0,) * dim)
        return Case(
            gimpmd=1,
            name=f"{wave.label}-{travel}",
            units=case.units,
            domain=Domain(box=tuple(box), periodic=tuple(k != axis for k in range(dim))),
            grid=Grid(cell=h, points_per_axis=case.grid.points_per_axis),
            time=Time(
                end=steps * times.step(case),
                md_timestep=times.md_timestep(case),
                md_steps=times.md_steps(case),
            ),
            md=Md(
                region=tuple(atoms),
                input=SCRIPT,
                files=(self.script, *case.atoms.files),
                minimize=case.atoms.minimize,
            ),
            continuum=_plain(case),
            coupling=_cold(case.coupling),
            boundary=Boundary(**{FACES[2 * axis]: held, FACES[2 * axis + 1]: held}),
            initial=Initial(packets=(packet,)),
            output=Output(interval=steps * times.step(case), energy_interval=times.step(case)),
        )

    def lammps(self, strip: Case) -> str:
        """Return the LAMMPS script of the atoms: the cell of the crystal, replicated and cut.

        The variables xlo, xhi, ylo, ... give the box, so the script serves the coupled strip and
        the run of MD only.
        """
        low, size = self.crystal.low, self.crystal.size
        copies = [
            math.ceil((high - start) / edge) + 1
            for (_, high), start, edge in zip(strip.domain.box, low, size, strict=True)
        ]
        eps, names = KEPT * self.cell, "xyz"[: strip.dim]
        kept = {f"{name}{side}": eps for name in names for side in ("lo", "hi")}
        across = [
            name for name, periodic in zip(names, strip.domain.periodic, strict=True) if periodic
        ]
        for name in across:  # atoms there are images of those at the lower face
            kept[f"{name}hi"] = -eps
        lines = [
            "# A strip of the crystal of the cell below, written by gimpmd verify interface.",
            *(f"variable strip_{name} equal ${{{name}}}" for name in kept),
            *(
                f"variable {name} delete" for name in kept
            ),  # the script of the cell may define its own
            f"include {self.script}",
            f"replicate {' '.join(map(str, [*copies, 1][:3]))}",
            *(
                f"variable strip_keep_{name} equal v_strip_{name}"
                f"{'-' if name.endswith('lo') else '+'}({shift!r})"
                for name, shift in kept.items()
            ),
            "region strip block "
            + " ".join(f"$(v_strip_keep_{name}:%.15g)" for name in kept)
            + (" INF INF" if strip.dim == 2 else "")
            + " units box",
            "group strip_kept region strip",
            "group strip_rest subtract all strip_kept",
            "delete_atoms group strip_rest compress yes",
            "group strip_rest delete",
            "group strip_kept delete",
            "region strip delete",
            *(
                f"change_box all {name} final $(v_strip_{name}lo:%.15g) "
                f"$(v_strip_{name}hi:%.15g) units box"
                for name in across
            ),
            "change_box all boundary "
            + " ".join("s" if name == names[self.axis] else "p" for name in "xyz"),
        ]
        return "\n".join(lines) + "\n"


def fitted(h: float, periods: Sequence[float]) -> tuple[float, tuple[int, ...]]:
    """Edge of cells, and the least numbers of them that span whole periods along each axis.

    Parameters
    ----------
    h : float
        Wanted edge; the edge found is smaller by at most the fraction ``MISFIT``.
    periods : sequence of float
        Of the crystal, along each axis across a strip (length).

    Raises
    ------
    ValueError
        No edge fits all periods.
    """
    found: list[tuple[int, float, tuple[int, ...]]] = []
    for first in range(NARROWEST, WIDEST + 1):
        most = math.floor(first * h / periods[0] * (1.0 + 1e-9))
        for count in range(most, 0, -1):
            cell = count * periods[0] / first
            if cell < (1.0 - MISFIT) * h:
                break
            others = [_least_count(cell, period) for period in periods[1:]]
            if 0 not in others:
                found.append((first * math.prod(others), -min(cell, h), (first, *others)))
    if not found:
        raise ValueError("no edge of cells fits all periods of the crystal")
    _, negative, counts = min(found)
    return -negative, counts


def _least_count(cell: float, period: float) -> int:
    """Least number of cells that spans whole periods; 0 if there is none."""
    for count in range(NARROWEST, WIDEST + 1):
        periods = count * cell / period
        if abs(periods - round(periods)) < SAME:
            return count
    return 0


def _others(axis: int, dim: int) -> list[int]:
    """The other axes, in cyclic order: waves tilt towards the first of them."""
    return [(axis + k) % dim for k in range(1, dim)]


def _depth(case: Case, axis: int) -> float:
    """Largest distance of a plane from the end of its region along an axis (length)."""
    return max(
        (
            abs(plane - end)
            for planes, region in zip(
                case.coupling.each_planes().values(), case.atoms.boxes().values(), strict=False
            )
            for plane, end in zip(planes.limits(case.dim)[axis], region[axis], strict=True)
            if math.isfinite(plane)
        ),
        default=0.0,
    )


def _speed(case: Case, packet: Packet) -> float:
    """Speed of a packet along its direction of travel; tilted ones need an isotropic body."""
    moved = packet.component(case.dim)
    return materials.axial_wave_speed(material(case), case.units, case.dim, packet.axis, moved)


def _cold(coupling: Coupling) -> Coupling:
    """The coupling without random forces, and without what was measured of another body."""
    absorber = coupling.absorber
    if absorber is not None:
        absorber = msgspec.structs.replace(absorber, temperature=0.0)
    return msgspec.structs.replace(
        coupling, crystal=None, planes=None, sites=None, absorber=absorber
    )


def _plain(case: Case) -> Continuum:
    """Settings of the continuum, without what belongs to the body of the case.

    A strip is cold, with the lattice constant at rest: thermal stress would set it in motion.
    """
    return msgspec.structs.replace(
        case.continuum,
        temperature=None,
        damping=tuple(one for one in case.continuum.damping if one.box is None),
        body_force=None,
        cracks=(),
        ranks=1,
        patches="auto",
        threads=1,
    )
