"""How all MPI ranks of a service end together when at least one of them fails.

MPICH's ``mpiexec`` ends all ranks when one is killed by a signal. But if one ends with a code
before it has started MPI, for example because it cannot import a package, the others wait for it
in ``MPI_Init`` for ever. So this module imports nothing large: a service imports it first.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from types import TracebackType
from typing import Any

from gimpmd_schemas.errors import GimpmdError

RANK = "PMI_RANK"
"""Environment variable of a process that was started as a rank of an MPI program."""

FAREWELL_SECONDS = 5.0
"""How long a failed rank waits for the other ranks to fail before it aborts them."""


def exit_code_of(error: BaseException) -> int:
    """Exit code of a process that ends with an error: 2 for bad input, 3 for a failure."""
    return error.exit_code if isinstance(error, GimpmdError) else GimpmdError.exit_code


def exit_together(comm: Any, error: BaseException, service: str) -> int:
    """Find the common exit code of all ranks, or abort ranks that would wait for ever.

    If all ranks fail within `FAREWELL_SECONDS`, all return the smallest of their exit codes: bad
    input (2) is the cause, and the ranks that only lost their peer (3) follow it. Otherwise this
    rank calls ``MPI_Abort``. MPICH's ``mpiexec`` then ends with this rank's code, or with 9, the
    code of a rank that it killed, whichever it learns of first.

    Parameters
    ----------
    comm : mpi4py communicator
        A communicator that is used for nothing else.
    error : BaseException
        The error that ends this rank.
    service : str
        Name of the program, printed before the error.

    Returns
    -------
    int
        The common exit code.
    """
    import numpy as np
    from mpi4py import MPI

    own = np.array(exit_code_of(error))
    common = np.empty_like(own)
    request = comm.Iallreduce(own, common, op=MPI.MIN)
    deadline = time.monotonic() + FAREWELL_SECONDS
    while not request.Test():
        if time.monotonic() > deadline:
            print(f"{service}: {error}", file=sys.stderr, flush=True)
            comm.Abort(int(own))
        time.sleep(0.01)
    if comm.rank == 0:
        print(f"{service}: {error}", file=sys.stderr, flush=True)
    return int(common)


def kill_rank_on_error() -> None:
    """Let errors that nobody catches kill this process if it is a rank of an MPI program."""
    if RANK in os.environ:
        sys.excepthook = _kill


def _kill(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    sys.__excepthook__(kind, error, trace)
    sys.stderr.flush()
    os.kill(os.getpid(), signal.SIGKILL)
