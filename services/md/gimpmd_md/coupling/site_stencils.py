"""Stencils, at their lattice positions, of atoms that move from rank to rank."""

from __future__ import annotations

from gimpmd_md.coupling.halo import Exchange, Halo
from gimpmd_md.coupling.shape_functions import ShapeFunctions, Stencils
from gimpmd_md.crystal.inner_shift import InnerShift
from gimpmd_md.engines.atoms import Atoms
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError


class SiteStencils:
    """The stencils of the atoms of this rank that have a role, and nodal sums over all ranks.

    The stencil of an atom never changes. The rank that holds the atom may: then the ranks agree
    whether all of them still hold the nodes of their atoms, and otherwise they hold other nodes.

    Parameters
    ----------
    plan : Plan
    atoms : Atoms
    bit : int
        Role bit of the atoms.
    wanted : ndarray of int64
        Ids of all canonical nodes that such atoms touch.
    half, shift : optional
        See `ShapeFunctions`.

    Attributes
    ----------
    halo : Halo
        The nodes that this rank holds.
    """

    def __init__(
        self,
        plan: Plan,
        atoms: Atoms,
        bit: int,
        wanted: Ints,
        half: Floats | None = None,
        shift: InnerShift | None = None,
    ) -> None:
        self._half, self._shift = half, shift
        self._atoms, self._bit, self._grid = atoms, bit, plan.background_grid()
        self.halo = Halo(atoms.comm, self._grid, plan.atoms.region, plan.atoms.patches, wanted)
        self._prepare()
        self._migrations: int | None = None  # of the atoms when they were found

    def _prepare(self) -> None:
        self._shapes = ShapeFunctions(self._grid, self.halo.nodes, self._half, self._shift)
        self._exchange = Exchange(self.halo, self.halo.rows, self._grid.dim)

    def find(self) -> tuple[Ints, Stencils]:
        """Rows of the atoms among the local atoms, and their stencils over `Halo.nodes`.

        Collective after atoms have moved to other ranks.

        Raises
        ------
        BackendError
            An atom lies outside the zone where such atoms may be.
        """
        atoms, halo = self._atoms, self.halo
        if atoms.migrations != self._migrations:
            rows, stencils, stray = self._marked()
            if atoms.comm.allreduce(int(stray >= 0)):
                halo.surround(atoms.site[rows])
                self._exchange.free()
                self._prepare()
                rows, stencils, stray = self._marked()
            if stray >= 0:
                position = ", ".join(f"{c:g}" for c in atoms.site[stray])
                raise BackendError(
                    f"the atom with lattice position ({position}) touches nodes beyond those of "
                    "the transition region"
                )
            self._found = rows, stencils
            self._migrations = atoms.migrations
        return self._found

    def _marked(self) -> tuple[Ints, Stencils, int]:
        return self._shapes.marked(self._atoms.role, self._bit, self._atoms.site)

    def sums(self, stencils: Stencils, values: Floats) -> Floats:
        """Sum values ``(n, d)`` of the atoms at the nodes ``halo.nodes``; collective."""
        sums = stencils.gather(values, self.halo.nodes.size)
        self._exchange.complete(sums)
        return sums
