"""The continuum service: ``gimpmd-gimp`` takes part in a run until the coupler tells it to stop."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from typing import Any

from gimpmd_coupler.arguments import add_arguments, keys_of
from gimpmd_coupler.exit import RANK, exit_code_of, exit_together
from gimpmd_coupler.loop import run_service
from gimpmd_coupler.participant import Participant
from gimpmd_gimp.coupling.solver_protocol import ContinuumSolver
from gimpmd_gimp.side import ContinuumSide
from gimpmd_schemas.case.plan import Plan, load_plan
from gimpmd_schemas.checkpoint.states import saved_states
from gimpmd_schemas.errors import BackendError, GimpmdError
from gimpmd_schemas.registry import load_code

log = logging.getLogger(__name__)


def main() -> int:
    """Entry point of ``gimpmd-gimp``; returns the exit code (0, 2 bad input, 3 failure)."""
    parser = argparse.ArgumentParser(prog="gimpmd-gimp", description=__doc__)
    add_arguments(parser)
    options = parser.parse_args()
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(message)s"
    )
    comm = exit_comm = None
    try:
        plan = load_plan(options.run_dir / "plan.yaml")
        if plan.continuum.ranks > 1:
            comm = _world(plan.continuum.ranks)
            exit_comm = comm.Dup()  # only failed ranks communicate here
        _take_part_in(plan, options, comm)
    except (Exception, SystemExit) as error:
        if isinstance(error, GimpmdError):
            log.error("%s", error)
        else:
            log.exception("the continuum service failed")
        if exit_comm is not None or RANK in os.environ:
            from mpi4py import MPI  # other ranks may wait for this one to start it

            return exit_together(exit_comm or MPI.COMM_WORLD, error, "gimpmd-gimp")
        return exit_code_of(error)
    return 0


def _world(ranks: int) -> Any:
    """Communicator of all ranks of the program.

    Raises
    ------
    BackendError
        The program has another number of ranks than the plan.
    """
    from mpi4py import MPI

    if ranks != MPI.COMM_WORLD.size:
        raise BackendError(
            f"started on {MPI.COMM_WORLD.size} MPI ranks, but continuum.ranks is {ranks}; start "
            f"it with mpiexec -n {ranks}"
        )
    return MPI.COMM_WORLD


def _take_part_in(plan: Plan, options: argparse.Namespace, comm: Any) -> None:
    code = load_code("continuum", plan.continuum.backend)
    rank = comm.rank if comm is not None else 0
    with Participant(
        endpoint=options.connect,
        run=options.run,
        plan=plan,
        role="continuum",
        rank=rank,
        ranks=plan.continuum.ranks,
        backend=code.version(),
        patch=plan.domain.box,
        keys=keys_of(options),
        patience=options.patience,
    ) as participant:
        participant.heed_sigterm()
        solver: ContinuumSolver = code(plan, comm, options.run_dir)
        log.info("%s", solver.summary())
        try:
            side, saved = (
                ContinuumSide(plan, solver),
                saved_states(options.run_dir, "continuum", rank, plan),
            )
            if saved:
                side.restore(saved)
            run_service(side, plan, participant, options.run_dir, saved)
        finally:
            solver.close()


if __name__ == "__main__":
    sys.exit(main())
