"""An error that nobody catches ends all ranks of an MPI program, also before MPI has started.

MPICH's ``mpiexec`` ends all ranks when one is killed by a signal. But if one ends with a code
before it has started MPI, for example because it cannot import a package, the others wait for it
in ``MPI_Init`` for ever. This module imports nothing large, so that it can be called first.
"""

from __future__ import annotations

import os
import signal
import sys
from types import TracebackType


def kill_rank_on_error() -> None:
    """Let errors that nobody catches kill this process if it is a rank of an MPI program."""
    if "PMI_RANK" in os.environ:
        sys.excepthook = _kill


def _kill(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    sys.__excepthook__(kind, error, trace)
    sys.stderr.flush()
    os.kill(os.getpid(), signal.SIGKILL)
