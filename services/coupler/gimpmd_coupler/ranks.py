"""How the MPI ranks of a service end together, whoever of them failed."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

from gimpmd_schemas.errors import GimpmdError

FAREWELL_SECONDS = 5.0
"""How long a failed rank waits for the others to fail as well before it ends them."""


def agree(comm: Any, error: BaseException, service: str) -> int:
    """Exit code of all ranks if all failed; otherwise end the ranks that would wait for ever.

    Bad input (2) outweighs a lost service (3): ranks that merely lost their peer follow it.

    Parameters
    ----------
    comm : mpi4py communicator
        One that nothing else uses.
    error : BaseException
        What this rank failed of.
    service : str
        Name of the program, for its last words.
    """
    from mpi4py import MPI

    own = np.array(error.exit_code if isinstance(error, GimpmdError) else 3)
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
