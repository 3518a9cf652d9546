"""Energy release rate from a J-integral over the continuum around the MD region of a run.

A weight q is 1 in a box around the crack tip and falls smoothly to 0 within a width outside. With
the displacement gradient H, the first Piola-Kirchhoff stress P, the strain energy W, the kinetic
energy T = rho v^2 / 2 and axis 1 along the growth of the crack::

    J = int [P_ij H_i1 - (W - T) delta_1j] q,j dV  +  d/dt int rho v_i H_i1 q dV  +  faces

The first integral needs only the particles where q falls, so no atom at the crack tip contributes
its stress. The second one, the rate of the pseudomomentum, is the inertia of everything inside,
atoms included. The sum is the energy that flows into the tip per advance, also for a tip that
moves (Moran and Shih, Eng. Fract. Mech. 27 (1987) 615, with their accelerations integrated by
parts). Where the box reaches a free face of the body, q is not zero on it, and the face with the
outer normal n adds ``int (W - T) n_1 q dS``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gimpmd_deploy.analysis.crack import Crack, crack_of
from gimpmd_deploy.analysis.gradient import Neighbours, displacement_gradient
from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.analysis.sides import counted
from gimpmd_deploy.results.frames import dataframe
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.materials import Hyperelastic, PairLattice
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.energy_momentum import domain_integral
from gimpmd_schemas.mechanics.units import UNITS

MARGIN, WIDTH = 2.0, 10.0
"""Default distance of the falling weight from the MD region, and its width, in finest cells."""


class State(NamedTuple):
    """Fields of ``n`` particles in two dimensions, in the pressure units of the case.

    Attributes
    ----------
    X : ndarray, shape ``(n, 2)``
        Reference positions.
    volume : ndarray, shape ``(n,)``
        Reference volumes (areas).
    v, H, P : ndarray, shapes ``(n, 2)``, ``(n, 2, 2)``, ``(n, 2, 2)``
        Velocity, displacement gradient, first Piola-Kirchhoff stress.
    W, density : ndarray, shape ``(n,)``
        Strain energy, and density in units for which ``density v^2 / 2`` is a pressure.
    """

    X: Floats
    volume: Floats
    v: Floats
    H: Floats
    P: Floats
    W: Floats
    density: Floats

    @property
    def lagrangian(self) -> Floats:
        """``W - T``, shape ``(n,)``."""
        return np.asarray(self.W - 0.5 * self.density * (self.v**2).sum(axis=1))

    def where(self, mask: Bools) -> State:
        """Return the particles for which ``mask`` is true."""
        return State(*(field[mask] for field in self))


class Weight(NamedTuple):
    """The weight q: 1 in a box, 0 outside the box grown by a width; a product of cosines.

    Infinite sides of the box are open: q does not fall there.
    """

    box: Box
    width: float

    def __call__(self, X: Floats) -> tuple[Floats, Floats]:
        """Return q, shape ``(n,)``, and its gradient, shape ``(n, 2)``."""
        parts = [self._along(X[:, axis], *sides) for axis, sides in enumerate(self.box)]
        (qx, sx), (qy, sy) = parts
        return qx * qy, np.stack([sx * qy, qx * sy], axis=1)

    def _along(self, x: Floats, low: float, high: float) -> tuple[Floats, Floats]:
        below, above = (x - low) / self.width, (high - x) / self.width
        outside = np.clip(-np.minimum(below, above), 0.0, 1.0)
        slope = -0.5 * np.pi / self.width * np.sin(np.pi * outside)
        return (
            np.asarray(0.5 * (1.0 + np.cos(np.pi * outside))),
            np.asarray(np.where(below < above, -slope, slope)),
        )


def flux(state: State, plane: Plane, weight: Weight) -> float:
    """Integrate ``[P_ij H_i1 - (W - T) delta_1j] q,j`` over particles (pressure times length)."""
    frame = np.stack([plane.along, plane.normal])
    dq = weight(state.X)[1] @ frame.T
    near = (dq != 0.0).any(axis=1)
    P, H = (np.einsum("ki,nij,lj->nkl", frame, field[near], frame) for field in (state.P, state.H))
    return domain_integral(state.volume[near], P, H, state.lagrangian[near], dq[near])


def pseudomomentum(state: State, plane: Plane, weight: Weight) -> float:
    """Integrate ``rho v_i H_i1 q`` over particles (pressure times length times time)."""
    q = weight(state.X)[0]
    slope = state.H @ plane.along
    return float((state.volume * state.density * q) @ (state.v * slope).sum(axis=1))


def face(
    state: State, plane: Plane, weight: Weight, axis: int, place: float, out: float, layer: float
) -> float:
    """Integrate ``(W - T) n_1 q`` over a free face, by the particles of a layer beside it.

    Parameters
    ----------
    axis, place, out : int, float, float
        Axis of the face, its coordinate, and the sign of its outer normal.
    layer : float
        Thickness of the layer that represents the face.
    """
    beside = state.where(np.abs(state.X[:, axis] - place) < layer)
    q = weight(beside.X)[0]
    return out * float(plane.along[axis] * (beside.volume * q) @ beside.lagrangian) / layer


@dataclass(frozen=True)
class JIntegral:
    """Energy release rate at ``k`` outputs (pressure times length), and its parts.

    Attributes
    ----------
    time : ndarray, shape ``(k,)``
    flux : ndarray, shape ``(k,)``
        Integral over the particles where the weight falls.
    inertia : ndarray, shape ``(k,)``
        Rate of the pseudomomentum inside, by differences of the outputs. It is exact for outputs
        close to each other, and NaN for a single output.
    faces : ndarray, shape ``(k,)``
        Contribution of the free faces of the body that the box reaches.
    """

    time: Floats
    flux: Floats
    inertia: Floats
    faces: Floats

    @property
    def J(self) -> Floats:  # noqa: N802  # the symbol of the literature
        """Energy release rate, shape ``(k,)``."""
        return self.flux + self.inertia + self.faces

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each output."""
        return dataframe({**vars(self), "J": self.J})


def j_integral(
    run: Run,
    crack: Crack | None = None,
    times: Sequence[float] | None = None,
    *,
    box: Box | None = None,
    width: float | None = None,
) -> JIntegral:
    """Energy release rate of a crack from the continuum around it.

    Parameters
    ----------
    run : Run
        In two dimensions, coupled or of the continuum only.
    crack : Crack, optional
        Its plane gives the direction of growth; default is the first crack of the case.
    times : sequence of float, optional
        Some of the outputs, default all. The inertia is found from differences between them.
    box : tuple of (float, float), optional
        Where the weight is one: limits along x and y. Only this crack may end in the box and the
        width around it. Default is the MD region and two cells around it. Limits on or beyond a
        face of the body leave the weight at one up to this face, which must be free of traction.
    width : float, optional
        Distance over which the weight falls to zero; default is ten cells.

    Returns
    -------
    JIntegral

    Raises
    ------
    InputError
        The run wrote no material points or is not two-dimensional, the box is missing, or the
        weight does not fall to zero inside the body.
    """
    plan, crack = run.plan, crack or crack_of(run)
    plane = crack.plane
    if plan.dim != 2:
        _refuse(run, "domain.box", "the J-integral is for two dimensions", "take a slice")
    weight = Weight(*_box(run, box, width))
    chosen = list(run.times if times is None else times)
    area = 0.0 if run.atoms_file is None else run.atoms_file.lattice[1]
    neighbours: Neighbours | None = None
    parts = []
    for time in chosen:
        state = state_of_points(run.points(time), plan)
        states = [state.where(counted(plan, "continuum", state.X))]
        if "md" in plan.roles:
            atoms = run.atoms(time)
            if neighbours is None:
                neighbours = Neighbours.of(atoms.reference, float(atoms.size[0, 0]), crack)
            state = state_of_atoms(atoms, neighbours, area, plan)
            states.append(state.where(counted(plan, "md", state.X)))
        parts.append(
            (
                flux(states[0], plane, weight),
                sum(pseudomomentum(state, plane, weight) for state in states),
                sum(_faces(state, plane, weight, plan) for state in states),
            )
        )
    of_flux, momentum, of_faces = np.array(parts).T
    at = np.array(chosen)
    inertia = np.gradient(momentum, at) if at.size > 1 else np.full(1, np.nan)
    return JIntegral(at, of_flux, inertia, of_faces)


def _refuse(run: Run, key: str, reason: str, hint: str) -> None:
    raise InputError(str(run.folder), [Problem(key, None, reason, hint)])


def _box(run: Run, box: Box | None, width: float | None) -> tuple[Box, float]:
    """Box of the weight, open where it reaches a face of the body, and its width."""
    plan, h = run.plan, run.plan.finest_cell
    if box is None:
        if plan.coupling is None:
            hint = "give box, the limits along x and y of a box around the crack tip"
            _refuse(run, "md.region", "the run has no MD region", hint)
        box = tuple((low - MARGIN * h, high + MARGIN * h) for low, high in plan.atoms.region)
    fall = WIDTH * h if width is None else width
    sides = []
    for axis, ((low, high), (first, last)) in enumerate(zip(box, plan.domain.box, strict=True)):
        opened = low <= first, high >= last
        if (not opened[0] and low - fall < first) or (not opened[1] and high + fall > last):
            hint = f"make width smaller than {fall:g}, or the box smaller along {'xy'[axis]}"
            _refuse(run, "domain.box", "ends before the weight has fallen to zero", hint)
        sides.append((-np.inf if opened[0] else low, np.inf if opened[1] else high))
    return tuple(sides), fall


def _faces(state: State, plane: Plane, weight: Weight, plan: Plan) -> float:
    """Contributions of the faces that the weight reaches."""
    layer = 2.0 * plan.finest_cell
    return sum(
        face(state, plane, weight, axis, plan.domain.box[axis][side], (-1.0, 1.0)[side], layer)
        for axis, limits in enumerate(weight.box)
        for side, limit in enumerate(limits)
        if np.isinf(limit) and not plan.domain.periodic[axis]
    )


def state_of_points(points: Particles, plan: Plan) -> State:
    """Fields of the material points of an output.

    Raises
    ------
    InputError
        The output lacks a field that an older version did not write.
    """
    for name in ("displacement_gradient", "strain_energy", "mass"):
        if name not in points.fields:
            problem = Problem(name, None, "is not in the file", "run the case again")
            raise InputError("fields/points.vtkhdf", [problem])
    material = plan.continuum.material
    H = np.asarray(points.fields["displacement_gradient"], dtype=float).reshape(-1, 2, 2)
    P = tensors(points.stress)
    if isinstance(material, Hyperelastic | PairLattice):
        F = H + np.eye(2)
        P = np.linalg.det(F)[:, None, None] * P @ np.linalg.inv(F).transpose(0, 2, 1)
    mass = np.asarray(points.fields["mass"], dtype=float).ravel()
    return State(
        X=points.reference,
        volume=mass / material.density,
        v=points.velocity,
        H=H,
        P=P,
        W=np.asarray(points.fields["strain_energy"], dtype=float).ravel(),
        density=np.full(mass.size, UNITS[plan.units].stress_from_mechanical(material.density)),
    )


def state_of_atoms(atoms: Particles, neighbours: Neighbours, area: float, plan: Plan) -> State:
    """Fields of the atoms of an output, as if they were a linear elastic continuum.

    The displacement gradient is that of the bonds; stress and strain energy follow from it with the
    stiffness of the continuum. ``area`` is that of an atom.
    """
    H = displacement_gradient(neighbours, atoms.displacement)
    strain = np.stack([H[:, 0, 0], H[:, 1, 1], H[:, 0, 1] + H[:, 1, 0]], axis=1)
    stress = strain @ plan.stiffness().T
    n, density = len(atoms), plan.continuum.material.density
    return State(
        X=atoms.reference,
        volume=np.full(n, area),
        v=atoms.velocity,
        H=H,
        P=tensors(stress),
        W=0.5 * np.einsum("nk,nk->n", stress, strain),
        density=np.full(n, UNITS[plan.units].stress_from_mechanical(density)),
    )


def tensors(voigt: Floats) -> Floats:
    """Symmetric tensors ``(n, d, d)`` from stress components in Voigt order."""
    d = 2 if voigt.shape[1] == 3 else 3
    out = np.empty((voigt.shape[0], d, d))
    for column, (i, j) in enumerate(VOIGT[d]):
        out[:, i, j] = out[:, j, i] = voigt[:, column]
    return out
