"""Where the tests find what starts MPI programs."""

from __future__ import annotations

import sys
from pathlib import Path

MPIEXEC = str(Path(sys.executable).with_name("mpiexec"))
"""That of the environment in which the tests run."""
