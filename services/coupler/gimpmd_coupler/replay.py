"""Plays one side of a run back: takes part in a run in place of a service of that side.

``python -m gimpmd_coupler.replay`` has the arguments of a service. ``replay/settings.json`` in the
run folder (`gimpmd_schemas.wire.replay`) says which side is played back, and from where. Each rank
of the side is a process; several are started by ``mpiexec``, like those of a service.
"""

from __future__ import annotations

import argparse
import logging
import math
import sys
from pathlib import Path

from gimpmd_coupler.arguments import add_arguments, keys_of
from gimpmd_coupler.exit import exit_code_of
from gimpmd_coupler.loop import run_service
from gimpmd_coupler.participant import Participant
from gimpmd_coupler.playback import Playback
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.recording import open_recording
from gimpmd_schemas.wire.replay import load_settings, write_result

log = logging.getLogger(__name__)


def play(options: argparse.Namespace) -> None:
    """Take part in a run as one rank of a side, from its recording.

    Raises
    ------
    InputError
        The settings, the plan or the recording cannot be read.
    PeerLostError, ProtocolError
        The run cannot go on.
    """
    run_dir: Path = options.run_dir
    settings, plan = load_settings(run_dir), load_plan(run_dir / "plan.yaml")
    ranks = plan.ranks(settings.side)
    rank = _rank() if ranks > 1 else 0
    with open_recording(Path(settings.recording)) as recording:
        register = recording.entries[settings.side, rank].register
        with Participant(
            endpoint=options.connect,
            run=options.run,
            plan=plan,
            role=settings.side,
            rank=rank,
            ranks=ranks,
            backend=f"recording of {register.backend}",
            patch=register.patch,
            keys=keys_of(options),
            patience=options.patience,
            longest_wait=math.inf,
        ) as participant:
            participant.heed_sigterm()
            side = Playback(recording, rank, settings, participant.ask_to_stop)
            try:
                run_service(side, plan, participant, run_dir)
            finally:
                write_result(run_dir, rank, side.compared())


def _rank() -> int:
    """Number of this process among those of ``mpiexec``."""
    from mpi4py import MPI

    return int(MPI.COMM_WORLD.rank)


def main() -> int:
    """Play a side back; returns the exit code (0, 2 bad input, 3 failure)."""
    parser = argparse.ArgumentParser(prog="python -m gimpmd_coupler.replay", description=__doc__)
    add_arguments(parser)
    options = parser.parse_args()
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(message)s"
    )
    try:
        play(options)
    except (Exception, SystemExit) as error:
        if isinstance(error, (GimpmdError, SystemExit)):
            log.error("%s", error)
        else:
            log.exception("the replay failed")
        return exit_code_of(error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
