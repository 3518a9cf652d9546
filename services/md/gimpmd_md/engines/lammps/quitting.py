"""The command ``quit`` of LAMMPS, which ends the whole process: say in which script it stands.

LAMMPS calls ``exit``, so no Python code runs afterwards, and the exit code is that of a good end. A
function that the C library calls at exit is the only place for a message.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from gimpmd_schemas.errors import BackendError

_AtExit = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


@contextmanager
def quit_is_an_error(script: str) -> Iterator[None]:
    """While LAMMPS reads a script, let ``quit`` end the process with a message and exit code 2."""
    reading = True

    def at_exit(_: object) -> None:
        if reading:
            message = "the command quit ended LAMMPS; remove it, since gimpmd ends LAMMPS itself"
            print(f"gimpmd-md: {script}: {message}", file=sys.stderr, flush=True)
            os._exit(BackendError.exit_code)

    library, function = ctypes.CDLL(None), _AtExit(at_exit)
    owner = ctypes.c_char()  # its address tells the C library which function is meant
    library["__cxa_atexit"](function, None, ctypes.byref(owner))
    try:
        yield
    finally:
        reading = False
        library["__cxa_finalize"](ctypes.byref(owner))  # calls the function, and forgets it
