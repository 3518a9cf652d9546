"""Work that the fixes of the user's script ``md.after`` do on the atoms.

A fix acts on the energy of atoms by forces, such as an indenter, a thermostat ``langevin`` or
``setforce`` on atoms that move, or by a change of velocities at the end of a step, such as
``temp/rescale``. In velocity Verlet the work of a force ``f`` on an atom is, up to terms that do
not add up,

    W = sum_n dt f_n v_n,    first and last step with half their weight,

which is what the atom gains from that force [1]_. LAMMPS calls fixes in the order in which they are
defined. A copy of all forces before the user's fixes and one after them differ by the forces of
these fixes; a copy of the velocities before them gives the kinetic energy that they add. LAMMPS
sums both over atoms and steps, so no Python runs between coupling steps.

.. [1] W. C. Swope et al., J. Chem. Phys. 76, 637 (1982).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.sums import power
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.mechanics.units import UNITS

OWN = "gimpmd_"
"""Beginning of the names of gimpmd's own fixes."""

_BEFORE, _AFTER, _VELOCITY = "gimpmd_before", "gimpmd_after", "gimpmd_velocity"
_MEAN = "gimpmd_fix_work"
_AXES = "xyz"

_HARMLESS = re.compile(
    r"(ave|store)/.*|balance|controller|dt/reset|enforce2d|halt|print|property/atom|vector"
)
"""Styles that act on no atom, or that do no work on atoms in the plane."""

_OF_VELOCITIES = re.compile(r"ehex|heat|momentum|oneway|temp/|thermal/conductivity|viscosity")
"""Beginnings of the styles that change velocities at the end of a step. To look for such changes
makes the measurement several times as slow."""

_OTHERWISE = re.compile(
    r"(adapt|alchemy|deform|qeq)(/.*)?|append/atoms|atom/swap|deposit|evaporate|gcmc|mol/swap|pour|"
    r"python/.*|recenter|sgcmc|srd|wall/reflect(/.*)?|widom"
)
"""Styles that change the energy otherwise: atoms, positions, the box, or the potential."""


class FixWork:
    """Measures the work of the fixes between `open` and `close`.

    Parameters
    ----------
    engine : Engine
    dim : int
        Number of dimensions.
    units : str
        Unit style.
    timestep : float
    steps : int
        MD steps in a coupling step.
    counted : int
        Role bits of the atoms on which work counts.

    Attributes
    ----------
    total : float
        Work since the start (energy units); the sum over the ranks is that of all atoms.
    """

    def __init__(
        self, engine: Engine, dim: int, units: str, timestep: float, steps: int, counted: int
    ) -> None:
        self._engine, self._units, self._dt = engine, UNITS[units], timestep
        self._dim, self._steps, self._counted = dim, steps, counted
        self._measuring = False
        self.total = 0.0

    def open(self) -> None:
        """Copy forces and velocities ahead of the fixes that are defined from here on."""
        velocity = " ".join(f"v{axis}" for axis in _AXES[: self._dim])
        self._engine.commands(
            [
                f"fix {_BEFORE} all store/force",
                f"fix {_VELOCITY} all store/state 1 {velocity}",
            ]
        )

    def close(self, group: str, core: str) -> None:
        """Sum the work of the fixes since `open`; call before other fixes that add forces.

        Parameters
        ----------
        group, core : str
            Groups of the atoms whose forces count, and of those whose kinetic energy counts.
        """
        users = {
            name: (style, acted_on)
            for name, (style, acted_on) in self._engine.fixes_with_groups().items()
            if not name.startswith(OWN) and not _HARMLESS.fullmatch(style)
        }
        self._measuring = bool(users)
        changing = any(_OF_VELOCITIES.match(style) for style, _ in users.values())
        if not changing:
            self._engine.commands([f"unfix {_VELOCITY}"])
        if not users:
            self._engine.commands([f"unfix {_BEFORE}"])
            return
        acted_on = " ".join(dict.fromkeys(group for _, group in users.values()))
        self._engine.commands(
            [
                f"fix {_AFTER} all store/force",
                f"group {_MEAN} union {acted_on}",
                f"group {_MEAN} intersect {_MEAN} {group}",
                *self._powers(changing, core),
                f"fix {_MEAN} all ave/time 1 {self._steps} {self._steps} c_{_MEAN}[1] c_{_MEAN}[2]",
            ]
        )

    def _powers(self, changing: bool, core: str) -> list[str]:
        """Commands for the power of the forces and the gain of kinetic energy at a step.

        A force that acts over two half steps meets the velocities before and after their change.
        """
        force, square = [], []
        for k, axis in enumerate(_AXES[: self._dim], start=1):
            old, new = f"f_{_VELOCITY}[{k}]", f"v{axis}"
            mean = f"0.5*({new}+{old})" if changing else new
            force.append(f"(f_{_AFTER}[{k}]-f_{_BEFORE}[{k}])*{mean}")
            square.append(f"({new}-{old})*({new}+{old})")
        gain = f"0.5*mass*gmask({core})*({'+'.join(square)})" if changing else "0.0"
        return [
            f'variable {_MEAN}_f atom "{"+".join(force)}"',
            f'variable {_MEAN}_v atom "{gain}"',
            f"compute {_MEAN} {_MEAN} reduce sum v_{_MEAN}_f v_{_MEAN}_v",
        ]

    def begin(self, role: Ints, v: Floats) -> None:
        """Note the power at the start of a coupling step, with the velocities it starts with."""
        if self._measuring:
            self.total += 0.5 * self._dt * self._power(role, v)

    def end(self, role: Ints, v: Floats) -> None:
        """Add the work of the coupling step that has ended."""
        if not self._measuring:
            return
        self.total -= 0.5 * self._dt * self._power(role, v)
        mean_power, mean_gain = self._engine.global_vector(_MEAN, 2)
        if self._engine.comm.rank == 0:
            gain = self._units.energy_from_mechanical(mean_gain)
            self.total += self._steps * (self._dt * mean_power + gain)

    def _power(self, role: Ints, v: Floats) -> float:
        """Power of the fixes on the counted atoms of this rank."""
        before, after = (self._engine.stored(name, 3)[:, : self._dim] for name in (_BEFORE, _AFTER))
        return power(role, self._counted, v, after) - power(role, self._counted, v, before)


def not_covered(script: str, fixes: Mapping[str, str], late: bool) -> list[str]:
    """Sentences about the fixes of a script whose work the energy balance does not cover.

    Parameters
    ----------
    script : str
        Its name, for the sentences.
    fixes : mapping of str to str
        Styles of its fixes by name.
    late : bool
        Whether the script is ``md.after``. Forces of earlier fixes cannot be told from those of the
        potential.
    """
    named = [
        f"{name} ({style})"
        for name, style in fixes.items()
        if not _HARMLESS.fullmatch(style) and (not late or _OTHERWISE.fullmatch(style))
    ]
    if not named:
        return []
    subject = f"fix {named[0]}" if len(named) == 1 else f"the fixes {', '.join(named)}"
    advice = "" if late else "; fixes in the script of md.after are covered"
    return [f"the energy balance does not cover the work of {subject} of {script}{advice}"]
