"""Fixes of the user that draw random numbers: they get new seeds when the state is renewed.

LAMMPS does not say how many random numbers a fix has drawn, so a run that goes on from a checkpoint
could not draw those that follow. Instead, each such fix is defined anew with a seed that follows
from the seed of the user and the step, and so in a run that is never interrupted. A fix that is
defined again under the same name keeps its place among the fixes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gimpmd_md.engines.lammps.library import Engine, text_of, without_accelerator
from gimpmd_md.engines.lammps.site_off.commands import commands_in

_SEEDS: dict[str, tuple[int, ...]] = {
    "langevin": (3,),
    "langevin/drude": (2, 5),
    "langevin/eff": (3,),
    "temp/csld": (3,),
    "temp/csvr": (3,),
    "wall/reflect/stochastic": (1,),
}
"""Places of the seeds after the style, for styles that keep no other state."""

_OTHERS = re.compile(
    r"atom/swap|bond/(break|create|swap)|bond/create/angle|charge/regulation|deposit|"
    r"electrode/thermo|evaporate|gcmc|mol/swap|neighbor/swap|pour|sgcmc|shardlow|srd|"
    r"ttm(/grid|/mod)?|widom"
)
"""Other styles that draw random numbers."""

_LARGEST = 800_000_000
"""LAMMPS adds the number of the rank to a seed, and accepts sums up to 900,000,000."""


@dataclass(frozen=True)
class RandomFix:
    """A fix that can be defined anew with another seed.

    Attributes
    ----------
    words : tuple of str
        Words of its command, from its name on.
    seeds : tuple of int
        Places of the seeds among the words.
    modify : tuple of str
        Commands ``fix_modify`` that follow.
    """

    words: tuple[str, ...]
    seeds: tuple[int, ...]
    modify: tuple[str, ...] = ()

    def anew(self, step: int) -> list[str]:
        """Commands that define the fix again, with the seeds of a step."""
        words = list(self.words)
        for place in self.seeds:
            words[place] = str(seed_at(int(words[place]), step))
        return [f"fix {' '.join(words)}", *self.modify]


def seed_at(seed: int, step: int) -> int:
    """Return the seed of a step, a positive number that LAMMPS accepts.

    Parameters
    ----------
    seed : int
        Of the user.
    step : int
        MD step.
    """
    return int(np.random.SeedSequence((seed, step)).generate_state(1)[0]) % _LARGEST + 1


def random_fixes(engine: Engine, fixes: Mapping[str, str]) -> tuple[RandomFix, ...]:
    """Find the fixes that can get other seeds, with their commands in LAMMPS's log; collective.

    Parameters
    ----------
    engine : Engine
    fixes : mapping of str to str
        Styles of the user's fixes by name.
    """
    if not any(without_accelerator(style) in _SEEDS for style in fixes.values()):
        return ()
    engine.lammps.flush_buffers()
    found: tuple[RandomFix, ...] = ()
    if engine.comm.rank == 0:
        found = fixes_in(text_of(engine.log), fixes)
    return tuple(engine.comm.bcast(found))


def fixes_in(log: str, fixes: Mapping[str, str]) -> tuple[RandomFix, ...]:
    """Find, in the text of a log, the commands of those fixes that can get other seeds."""
    found: dict[str, RandomFix] = {}
    plain = {name: without_accelerator(style) for name, style in fixes.items()}
    places = {name: _SEEDS[style] for name, style in plain.items() if style in _SEEDS}
    for line in commands_in(log):
        command, *words = line.split()
        name = words[0] if words else ""
        if command == "fix" and name in places and len(words) > 2:
            found[name] = RandomFix(tuple(words), tuple(3 + place for place in places[name]))
        elif command == "fix_modify" and name in found:
            fix = found[name]
            found[name] = RandomFix(fix.words, fix.seeds, (*fix.modify, " ".join(line.split())))
    return tuple(found.values())


def not_repeated(fixes: Mapping[str, str], repeated: Sequence[RandomFix]) -> tuple[str, ...]:
    """Sentences about fixes whose random numbers begin again when a run goes on.

    Parameters
    ----------
    fixes : mapping of str to str
        Styles of the user's fixes by name.
    repeated : sequence of RandomFix
        Those that get other seeds.
    """
    known = {fix.words[0] for fix in repeated}
    plain = {name: without_accelerator(style) for name, style in fixes.items() if name not in known}
    return tuple(
        f"if this run goes on from a checkpoint, the random numbers of fix {name} ({style}) begin "
        "again, and the results are not those of a run without an interruption"
        for name, style in plain.items()
        if style in _SEEDS or _OTHERS.fullmatch(style)
    )
