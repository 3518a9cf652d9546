"""Checks a service: prepares the bodies, and starts the process that plays the other sides."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from gimpmd_deploy.check.cases import BLOCK, STRIP, prepare
from gimpmd_deploy.launch.processes import ENVIRONMENT, mpiexec
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.wire.conformance import Checked, Group

CHECKER = "gimpmd_coupler.check"


def own_command(side: Role) -> list[str]:
    """Command of the service of a side that comes with gimpmd.

    Raises
    ------
    BackendError
        The MD service needs MPI, and there is no ``mpiexec``.
    """
    if side == "md":
        return [mpiexec(), "-n", "1", sys.executable, "-m", "gimpmd_md.service", "serve"]
    return [sys.executable, "-m", "gimpmd_gimp.service"]
