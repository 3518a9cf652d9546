"""The continuum service: ``gimpmd-gimp`` takes part in a run until the coupler says stop."""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from gimpmd_coupler.participant import Participant
from gimpmd_coupler.ranks import agree
from gimpmd_gimp.side import ContinuumBackend, GimpBackend
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.errors import BackendError, GimpmdError

log = logging.getLogger(__name__)


class Timings:
    """Wall seconds by phase since they were last taken."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count what runs inside under ``name``."""
        start = time.perf_counter()
        yield
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - start

    def take(self) -> dict[str, float]:
        """Return the phases and start anew."""
        seconds, self._seconds = self._seconds, {}
        return seconds


def take_part(backend: ContinuumBackend, case: Case, participant: Participant) -> None:
    """Register, then exchange and advance in lockstep until told to stop."""
    accepted = participant.register(offers=backend.offers, needs=backend.needs)
    timings = Timings()
    step, every = accepted.first_step, case.output_every()

    def finish(step: int, now: float) -> None:
        """What nobody waits for, while the fields are on their way."""
        with timings.phase("finish"):
            backend.finish()
        if step % every == 0:
            with timings.phase("output"):
                backend.write(now)

    while True:
        now = step * case.step()
        fields = backend.zone_fields()
        incoming = participant.exchange(step, now, fields, partial(finish, step, now))
        with timings.phase("receive"):
            backend.receive(incoming.fields)
        if incoming.directive == "stop":
            participant.account(backend.energies(), timings.take())
            log.info("stopped at step %d, t = %g", step, now)
            return
        with timings.phase("step"):
            backend.advance()
        participant.account(backend.energies(), timings.take())
        step += 1


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
            return agree(last_words, error, "gimpmd-gimp")
        return error.exit_code if isinstance(error, GimpmdError) else 3
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
    with Participant(
        endpoint=options.connect,
        run=options.run,
        case=case,
        role="continuum",
        rank=comm.rank if comm is not None else 0,
        ranks=case.continuum.ranks,
        backend="gimp",
        patch=case.domain.box,
    ) as participant:
        backend = GimpBackend(case, options.run_dir, comm)
        log.info("%s", backend.summary())
        try:
            take_part(backend, case, participant)
        finally:
            backend.close()


if __name__ == "__main__":
    sys.exit(main())
