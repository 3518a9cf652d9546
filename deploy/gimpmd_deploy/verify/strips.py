"""Strips of the user's crystal: continuum on one side, atoms on the other, and a wave packet.

A strip is periodic across its length. The packet starts three and a half standard deviations before
the interface and ends as far behind it. Lengths in "cells" are in cells of the strip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import msgspec

from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.derive import levels, times
from gimpmd_schemas.case.derive.material import wave_speed
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
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.wire.answers import Repeat

Travel = Literal["into", "out"]
"""From the continuum into the atoms, or out of the atoms."""

SCRIPT = "strip.in"
REACH = 2.5
"""Half-length (wavelengths) of a packet of two cycles; all but 4e-5 of its energy lies within."""
MARGIN = 8.0
"""Extra cells before and behind a packet: waves on a grid are slower than in the material."""
STRAIN = 2e-4
"""Amplitude of the strain: small enough for any crystal to be linear."""
MISFIT = 0.04
"""Largest fraction by which cells of a strip are smaller than those of the case."""
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
    across : number of cells across the narrowest strip.
    """

    case: Case
    script: str
    crystal: Repeat
    axis: Literal[0, 1]
    cell: float
    across: int

    @classmethod
    def of(cls, case: Case, script: str, crystal: Repeat, axis: Literal[0, 1] = 0) -> Ground:
        """Choose a cell such that a whole number of cells spans whole periods of the crystal."""
        h, period = levels.finest_cell(case), crystal.period[1 - axis]
        across = 2
        while True:
            periods = math.floor(across * h / period * (1.0 + 1e-9))
            cell = periods * period / across
            if cell >= (1.0 - MISFIT) * h:
                return cls(case, script, crystal, axis, min(cell, h), across)
            across += 1

    def oblique(self, wavelength: float, polarization: Literal["P", "S"], degrees: float) -> Wave:
        """Return the wave nearest to an angle that is periodic across some strip."""
        strips = max(1, round(wavelength / math.sin(math.radians(degrees)) / self.across))
        strips = max(strips, math.ceil((wavelength + 1e-9) / self.across))
        angle = math.degrees(math.asin(wavelength / (strips * self.across)))
        return Wave(wavelength, polarization, angle)

    def strip(self, wave: Wave, travel: Travel) -> Case:
        """Return the case of a packet that crosses the interface; below it is the continuum."""
        h, axis, case = self.cell, self.axis, self.case
        reach = REACH * wave.wavelength
        cells = math.ceil(2.0 * reach + MARGIN)
        across = self.across
        if wave.degrees:
            across = round(wave.wavelength / math.sin(math.radians(wave.degrees)))
        low = self.crystal.low
        start = low[axis]
        interface, end = start + cells * h, start + 2 * cells * h
        width = (low[1 - axis], low[1 - axis] + across * h)
        packet = Packet(
            center=interface + (-reach if travel == "into" else reach) * h,
            wavelength=wave.wavelength * h,
            strain=STRAIN,
            axis=axis,
            direction=1 if travel == "into" else -1,
            polarization=wave.polarization,
            tilt=wave.degrees,
        )
        speed = wave_speed(case, wave.polarization) * math.cos(math.radians(wave.degrees))
        steps = math.ceil((2.0 * reach + MARGIN) * h / speed / times.step(case))
        held = Face(condition="velocity", value=(0.0, 0.0))
        return Case(
            gimpmd=1,
            name=f"{wave.label}-{travel}",
            units=case.units,
            domain=Domain(box=_along(axis, (start, end), width), periodic=(axis == 1, axis == 0)),
            grid=Grid(cell=h, points_per_axis=case.grid.points_per_axis),
            time=Time(
                end=steps * times.step(case),
                md_timestep=times.md_timestep(case),
                md_steps=times.md_steps(case),
            ),
            md=Md(
                region=_along(axis, (interface, end), width),
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

        The variables xlo, xhi, ylo, yhi give the box, so the script serves the coupled strip and
        the run of MD only.
        """
        low, size = self.crystal.low, self.crystal.size
        copies = [
            math.ceil((high - start) / edge) + 1
            for (_, high), start, edge in zip(strip.domain.box, low, size, strict=True)
        ]
        eps = KEPT * self.cell
        kept = {f"{name}{side}": eps for name in "xy" for side in ("lo", "hi")}
        across = [
            name for name, periodic in zip("xy", strip.domain.periodic, strict=True) if periodic
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
            f"replicate {copies[0]} {copies[1]} 1",
            *(
                f"variable strip_keep_{name} equal v_strip_{name}"
                f"{'-' if name.endswith('lo') else '+'}({shift!r})"
                for name, shift in kept.items()
            ),
            "region strip block $(v_strip_keep_xlo:%.15g) $(v_strip_keep_xhi:%.15g) "
            "$(v_strip_keep_ylo:%.15g) $(v_strip_keep_yhi:%.15g) INF INF units box",
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
            + " ".join("p" if name in across else "s" for name in "xy")
            + " p",
        ]
        return "\n".join(lines) + "\n"


def _along(axis: int, along: tuple[float, float], across: tuple[float, float]) -> Box:
    return (along, across) if axis == 0 else (across, along)


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
