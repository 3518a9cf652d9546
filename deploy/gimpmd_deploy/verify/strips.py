"""Strips of the user's crystal, continuum on one side and atoms on the other, and waves on them.

A strip repeats across; a wave packet starts three and a half standard deviations before the
interface and ends as far behind it. Lengths called "cells" are counted in the strip's cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import h5py
import msgspec

from gimpmd_deploy.results.reading import AtomsFile, Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import (
    FACES,
    Boundary,
    Case,
    Continuum,
    Coupling,
    Domain,
    Face,
    Grid,
    Initial,
    Md,
    Output,
    Packet,
    Time,
)
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.answers import Repeat

Travel = Literal["into", "out"]
"""From the continuum into the atoms, or out of them."""

SCRIPT = "strip.in"
REACH = 2.5
"""Wavelengths from its middle that hold a packet of two cycles: all but 4e-5 of its energy."""
MARGIN = 8.0
"""Cells more than a packet needs, before it and behind; grids are slower than their material."""
STRAIN = 2e-4
"""Amplitude: small enough for any crystal to be linear."""
MISFIT = 0.04
"""How much smaller than the case's cells those of a strip may be, so that it repeats."""
KEPT = 1e-7
"""Atoms so many cells outside a rim are still kept."""


@dataclass(frozen=True)
class Wave:
    """A plane wave.

    Attributes
    ----------
    wavelength : in cells.
    polarization : ``P`` or ``S``.
    degrees : its angle to the normal of the interface.
    """

    wavelength: float
    polarization: Literal["P", "S"] = "P"
    degrees: float = 0.0

    @property
    def label(self) -> str:
        """Name that tells it from others."""
        tilt = f"-{self.degrees:.1f}deg" if self.degrees else ""
        return f"{self.polarization}-{self.wavelength:g}h{tilt}"


@dataclass(frozen=True)
class Ground:
    """Case and crystal behind strips, and how these are cut.

    Attributes
    ----------
    case : its material, coupling, steps and integration are the strips'.
    script : LAMMPS script of a periodic cell of the crystal.
    crystal : how that cell repeats.
    axis : normal of the interface.
    cell : edge of the grid's cells, a little less than the case's if the strip would not repeat.
    across : cells over the width of the narrowest strip.
    """

    case: Case
    script: str
    crystal: Repeat
    axis: Literal[0, 1]
    cell: float
    across: int

    @classmethod
    def of(cls, case: Case, script: str, crystal: Repeat, axis: Literal[0, 1] = 0) -> Ground:
        """Choose cells of which a whole number spans a whole number of the crystal's periods."""
        h, period = case.finest_cell(), crystal.period[1 - axis]
        across = 2
        while True:
            periods = math.floor(across * h / period * (1.0 + 1e-9))
            cell = periods * period / across
            if cell >= (1.0 - MISFIT) * h:
                return cls(case, script, crystal, axis, min(cell, h), across)
            across += 1

    def oblique(self, wavelength: float, polarization: Literal["P", "S"], degrees: float) -> Wave:
        """The wave nearest to an angle that repeats once over the width of some strip."""
        strips = max(1, round(wavelength / math.sin(math.radians(degrees)) / self.across))
        strips = max(strips, math.ceil((wavelength + 1e-9) / self.across))
        angle = math.degrees(math.asin(wavelength / (strips * self.across)))
        return Wave(wavelength, polarization, angle)

    def strip(self, wave: Wave, travel: Travel) -> Case:
        """Case of a packet that crosses the interface, with continuum on the lower side."""
        h, axis, case = self.cell, self.axis, self.case
        reach = REACH * wave.wavelength
        cells = math.ceil(2.0 * reach + MARGIN)
        across = self.across
        if wave.degrees:
            across = round(wave.wavelength / math.sin(math.radians(wave.degrees)))
        low = self.crystal.low
        start = low[axis]
        interface, end = start + cells * h, start + 2 * cells * h
        rim = (low[1 - axis], low[1 - axis] + across * h)
        packet = Packet(
            center=interface + (-reach if travel == "into" else reach) * h,
            wavelength=wave.wavelength * h,
            strain=STRAIN,
            axis=axis,
            direction=1 if travel == "into" else -1,
            polarization=wave.polarization,
            tilt=wave.degrees,
        )
        speed = case.wave_speed(wave.polarization) * math.cos(math.radians(wave.degrees))
        steps = math.ceil((2.0 * reach + MARGIN) * h / speed / case.step())
        held = Face(condition="velocity", value=(0.0, 0.0))
        return Case(
            gimpmd=1,
            name=f"{wave.label}-{travel}",
            units=case.units,
            domain=Domain(box=_along(axis, (start, end), rim), periodic=(axis == 1, axis == 0)),
            grid=Grid(cell=h, points_per_axis=case.grid.points_per_axis),
            time=Time(
                end=steps * case.step(),
                md_timestep=case.md_timestep(),
                md_steps=case.md_steps(),
            ),
            md=Md(
                region=_along(axis, (interface, end), rim),
                input=SCRIPT,
                files=(self.script, *case.atoms.files),
                minimize=case.atoms.minimize,
            ),
            continuum=_plain(case),
            coupling=_cold(case.coupling),
            boundary=Boundary(**{FACES[2 * axis]: held, FACES[2 * axis + 1]: held}),
            initial=Initial(packets=(packet,)),
            output=Output(interval=steps * case.step(), energy_interval=case.step()),
        )

    def lammps(self, strip: Case) -> str:
        """LAMMPS script of a strip's atoms: the crystal's cell, repeated and cut.

        It serves the coupled strip and all atoms alike, by the variables xlo, xhi, ylo, yhi.
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
        for name in across:  # what lies there is the image of what lies at the lower rim
            kept[f"{name}hi"] = -eps
        lines = [
            "# A strip of the crystal of the cell below, made by gimpmd verify interface.",
            *(f"variable strip_{name} equal ${{{name}}}" for name in kept),
            *(f"variable {name} delete" for name in kept),  # the cell may have its own
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
    """The coupling without random forces, and without what was found of another body."""
    absorber = coupling.absorber
    if absorber is not None:
        absorber = msgspec.structs.replace(absorber, temperature=0.0)
    return msgspec.structs.replace(coupling, crystal=None, planes=None, absorber=absorber)


def _plain(case: Case) -> Continuum:
    """How the continuum is integrated, without what belongs to the case's own body.

    A strip is cold and as long as the crystal at rest: thermal stress would set it in motion.
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


def crossing(run: Run) -> tuple[float, float]:
    """Reflected and transmitted share of the energy of a strip's packet, at the end of its run.

    Of a coupled strip by the books of both sides; of one side alone by what lies on either side of
    where the interface would be. Of atoms twice the kinetic energy counts, as in any travelling
    wave: the potential energy of those next to the plane is of first order in their displacements,
    since the other side has a part of their bonds, which says nothing of waves and swings by a
    tenth of the packet's energy. "Reflected" is whatever is left there: strain that the grid does
    not see stays where the packet started.
    """
    packet = run.case.initial.packets[0]
    if run.case.only is None:
        lower, upper = float(energies(run)[0][-1]), _kinetic(run)
    else:
        [region] = run.case.atoms.boxes().values()
        plane = region[packet.axis][0]
        x, start, end = (_points if run.case.only == "continuum" else _atoms)(run)
        below = x[:, packet.axis] < plane
        lower, upper = (float(end[part].sum() / start.sum()) for part in (below, ~below))
    return (lower, upper) if packet.direction == 1 else (upper, lower)


def _kinetic(run: Run) -> float:
    """Twice the atoms' kinetic energy over all energy of the start.

    The mean over the last twentieth: where a packet has come back from an end, kinetic and
    potential energy take turns.
    """
    time, kinetic = run.series.time, run.series.sides["md"]["kinetic"]
    return float(2.0 * kinetic[time >= 0.95 * time[-1]].mean() / run.series.energy[0])


def energies(run: Run) -> tuple[Floats, Floats]:
    """Kinetic and potential energy of continuum and atoms over time, over that of the start."""
    sides = run.series.sides
    continuum, md = (
        sides[role]["kinetic"] + sides[role]["potential"] for role in ("continuum", "md")
    )
    total = continuum[0] + md[0]
    return continuum / total, md / total


def _points(run: Run) -> tuple[Floats, Floats, Floats]:
    """Sites of the material points, and their energies at the start and the end."""
    units, density = UNITS[run.case.units], run.case.material().density
    with h5py.File(run.folder / "fields" / "points.vtkhdf") as file:
        root = file["VTKHDF"]
        data, count = root["PointData"], int(root["NumberOfPoints"][0])
        volume = data["size"][:count, :2].prod(axis=1)
        stress = units.stress_to_mechanical(1.0)
        start, end = (
            volume
            * (
                density * (data["velocity"][rows] ** 2).sum(axis=1)
                + stress * (data["stress"][rows] * data["strain"][rows]).sum(axis=1)
            )
            for rows in (slice(0, count), slice(-count, None))
        )
        return data["reference"][:count, :2], start, end


def _atoms(run: Run) -> tuple[Floats, Floats, Floats]:
    """The same of the atoms, of kinetic energy.

    Whatever their masses: in these waves the atoms of a primitive cell move together.
    """
    atoms = AtomsFile(run.folder / "atoms" / "atoms.dump", run.case.md_timestep())
    start, end = (atoms.columns(index, ("X0", "Y0", "vx", "vy")) for index in (0, -1))
    return start[:, :2], *((rows[:, 2:] ** 2).sum(axis=1) for rows in (start, end))
