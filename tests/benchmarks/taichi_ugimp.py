"""A step of uGIMP in Taichi, for comparison: USL, linear elastic, two dimensions, float64.

Written as Taichi's own MPM examples are: one kernel from points to grid, one over the grid, one
back; points lie in memory in the order of their cells. Not a part of gimpmd.

    python -m tests.benchmarks.taichi_ugimp POINTS THREADS

prints million point-updates per second of wall time, and of processor time times threads.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import taichi as ti

LAME = SHEAR = 1.0 / 3.0
REPEATS = 5


def main(count: int, threads: int) -> None:
    ti.init(arch=ti.cpu, default_fp=ti.f64, cpu_max_num_threads=threads, log_level=ti.ERROR)
    cells = round(count**0.5 / 2)
    n, size, h = 4 * cells**2, cells + 5, 1.0 / cells
    dt, mass = 0.1 * h, 0.25 * h * h
    x, v, stress = (ti.Vector.field(k, ti.f64, n) for k in (2, 2, 3))
    momentum, force = (ti.Vector.field(2, ti.f64, (size, size)) for _ in range(2))
    nodal_mass = ti.field(ti.f64, (size, size))

    axis = (np.arange(2 * cells) + 0.5) / 2 + 2
    lattice = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = np.floor(lattice + 0.5)
    lattice = lattice[np.lexsort((nearest[:, 1], nearest[:, 0]))]
    x.from_numpy(lattice * h)
    v.from_numpy(0.01 * np.sin(2.0 * np.pi * lattice * h))

    @ti.func
    def weights(t):
        """uGIMP weights and gradients, points a quarter of a cell wide to each side."""
        centre = ti.floor(t + 0.5)
        r = t - centre
        left = ti.math.clamp(0.25 - r, 0.0, 0.5)
        right = 0.5 - left
        g0, g2 = -2.0 * left, 2.0 * right
        s0 = ti.max(-r - 0.25, 0.0) - 0.5 * left * g0
        s2 = ti.max(r - 0.25, 0.0) + 0.5 * right * g2
        s = ti.Matrix.rows([s0, 1.0 - s0 - s2, s2])
        g = ti.Matrix.rows([g0, -g0 - g2, g2])
        return ti.cast(centre, ti.i32) - 1, s, g

    @ti.kernel
    def to_grid():
        for p in x:
            base, s, g = weights(x[p] / h)
            tau = ti.Matrix([[stress[p][0], stress[p][2]], [stress[p][2], stress[p][1]]])
            for i, j in ti.static(ti.ndrange(3, 3)):
                weight = s[i, 0] * s[j, 1]
                slope = ti.Vector([g[i, 0] * s[j, 1], s[i, 0] * g[j, 1]]) / h
                node = base + ti.Vector([i, j])
                nodal_mass[node] += weight * mass
                momentum[node] += weight * mass * v[p]
                force[node] -= mass * (tau @ slope)

    @ti.kernel
    def solve():
        for i, j in nodal_mass:
            if nodal_mass[i, j] > 1e-14:
                force[i, j] /= nodal_mass[i, j]
                momentum[i, j] = momentum[i, j] / nodal_mass[i, j] + dt * force[i, j]

    @ti.kernel
    def to_points():
        for p in x:
            base, s, g = weights(x[p] / h)
            velocity, acceleration = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
            rate = ti.Matrix([[0.0, 0.0], [0.0, 0.0]])
            for i, j in ti.static(ti.ndrange(3, 3)):
                weight = s[i, 0] * s[j, 1]
                slope = ti.Vector([g[i, 0] * s[j, 1], s[i, 0] * g[j, 1]]) / h
                node = base + ti.Vector([i, j])
                velocity += weight * momentum[node]
                acceleration += weight * force[node]
                rate += momentum[node].outer_product(slope)
            x[p] += dt * velocity
            v[p] += dt * acceleration
            trace, both = LAME * (rate[0, 0] + rate[1, 1]), SHEAR * (rate[0, 1] + rate[1, 0])
            normal = ti.Vector([rate[0, 0], rate[1, 1]]) * (2.0 * SHEAR) + trace
            stress[p] += dt * ti.Vector([normal[0], normal[1], both])

    def step() -> None:
        for field in (nodal_mass, momentum, force):
            field.fill(0.0)
        to_grid()
        solve()
        to_points()

    step()
    ti.sync()
    steps = max(3, 1_000_000 // n)
    clocks = (time.perf_counter, time.process_time)
    best = [float("inf")] * 2
    for _ in range(REPEATS):
        start = [clock() for clock in clocks]
        for _ in range(steps):
            step()
        ti.sync()
        spent = [clock() - before for clock, before in zip(clocks, start, strict=True)]
        best = [min(a, b / steps) for a, b in zip(best, spent, strict=True)]
    if not np.isfinite(v.to_numpy()).all():
        raise SystemExit("taichi_ugimp: the run is unstable")
    print(n / best[0] / 1e6, n / best[1] / 1e6 * threads)


if __name__ == "__main__":
    main(int(float(sys.argv[1])), int(sys.argv[2]))
