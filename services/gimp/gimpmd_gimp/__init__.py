"""The continuum side of gimpmd: the generalized interpolation material point method (GIMP).

Modules import only from packages and modules above them in this list:

- ``sweeps``: kernels over points and nodes, vectors in registers, threads, chains of sweeps;
- ``grid``: nested levels, the nodes of a rank, constraints, sums over ranks, time of every level;
- ``laws``: constitutive laws, one module for each;
- ``points``: material points, their distribution and splitting, groups, and the body;
- ``boundary``: conditions on the body, one module for each;
- ``fracture``: cracks, contact of their faces, J-integrals;
- ``step``: one step: stages, integrators, energies, and the solver;
- ``output``: files with fields, and checkpoints;
- ``coupling``: the coupling schemes, and what they need from a continuum code;
- ``setup``: from a plan to a solver;
- ``gimp``: GIMP as one of the continuum codes;
- ``side``: one coupling step with any continuum code;
- ``service``: the process that takes part in a run.
"""

from gimpmd_coupler.exit import kill_rank_on_error

kill_rank_on_error()  # before anything is imported that may fail
