"""Bodies with cracks: density 1, longitudinal wave speed 1, shear wave speed ``sqrt(1/3)``."""

from __future__ import annotations

from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
FREE = (False, False)

RIM = ((((16, 48), (16, 32)),),)
"""A finer level in the middle of 32 x 24 cells."""


def body(hierarchy, *lines, comm=None, friction=None, integrator="usavg", xpic=0, **conditions):
    cracks = make_cracks(lines, hierarchy, friction)
    mesh = Mesh(hierarchy, comm, cracks=cracks)
    method = Method(integrator=integrator, xpic_every=xpic)
    dt = 0.4 / 2**hierarchy.top
    return Solver(mesh, fill(mesh, 2, 1.0), LAW, method, dt, cracks=cracks, **conditions)
