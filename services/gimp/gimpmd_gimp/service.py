"""The continuum service: ``gimpmd-gimp`` takes part in a run until the coupler says stop."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gimpmd_coupler.exit import exit_code_of, exit_together
from gimpmd_coupler.loop import Timings, run_service
from gimpmd_coupler.participant import Participant
from gimpmd_gimp.side import ContinuumBackend, GimpBackend
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import plan_of_run
from gimpmd_schemas.errors import BackendError, GimpmdError
from gimpmd_schemas.wire.energies import Energies

log = logging.getLogger(__name__)


class _Side:
    """The continuum backend as a `gimpmd_coupler.loop.Side`."""

    def __init__(self, backend: ContinuumBackend, dim: int) -> None:
        self._backend, self._dim = backend, dim
        self.offers, self.needs = backend.offers, backend.needs
        self.timings = Timings()
        self.write, self.close = backend.write, backend.close

    def zone_fields(self) -> Mapping[str, Floats]:
        return self._backend.zone_fields()

    def finish(self) -> None:
        with self.timings.phase("finish"):
            self._backend.finish()

    def receive(self, fields: Mapping[str, Floats]) -> None:
        with self.timings.phase("receive"):
            self._backend.receive(fields)

    def advance(self) -> None:
        with self.timings.phase("step"):
            self._backend.advance()

    def energies(self) -> Energies | None:
        found = dict(self._backend.energies())
        if not found:
            return None
        momentum = tuple(found.pop(f"momentum_{axis}") for axis in "xyz"[: self._dim])
        return Energies(**found, momentum=momentum)


def main() -> int:
    """Entry point of ``gimpmd-gimp``; returns the exit code (0, 2 bad input, 3 failure)."""
    parser = argparse.ArgumentParser(prog="gimpmd-gimp", description=__doc__)
    parser.add_argument("--run-dir", type=Path, required=True, help="folder of the run")
    parser.add_argument("--run", required=True, help="id of the run")
    parser.add_argument("--connect", required=True, help="endpoint of the coupler")
    options = parser.parse_args()
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(message)s"
    )
    comm = last_words = None
    try:
        case = load_case(options.run_dir / "case.yaml")
        if case.continuum.ranks > 1:
            comm = _world(case.continuum.ranks)
            last_words = comm.Dup()  # nothing else may answer what failed ranks ask each other
        _take_part_in(case, options, comm)
    except (Exception, SystemExit) as error:
        if isinstance(error, GimpmdError):
            log.error("%s", error)
        else:
            log.exception("the continuum service failed")
        if last_words is not None:
            return exit_together(last_words, error, "gimpmd-gimp")
        return exit_code_of(error)
    return 0


def _world(ranks: int) -> Any:
    """All ranks of the program.

    Raises
    ------
    BackendError
        There are not as many as the case wants.
    """
    from mpi4py import MPI

    if ranks != MPI.COMM_WORLD.size:
        raise BackendError(
            f"started on {MPI.COMM_WORLD.size} MPI ranks, but continuum.ranks is {ranks}; start "
            f"it with mpiexec -n {ranks}"
        )
    return MPI.COMM_WORLD


def _take_part_in(case: Case, options: argparse.Namespace, comm: Any) -> None:
    plan = plan_of_run(options.run_dir)
    with Participant(
        endpoint=options.connect,
        run=options.run,
        plan=plan,
        role="continuum",
        rank=comm.rank if comm is not None else 0,
        ranks=case.continuum.ranks,
        backend="gimp",
        patch=case.domain.box,
    ) as participant:
        backend = GimpBackend(case, options.run_dir, comm)
        log.info("%s", backend.summary())
        try:
            run_service(_Side(backend, plan.dim), plan, participant)
        finally:
            backend.close()


if __name__ == "__main__":
    sys.exit(main())
