"""Errors of a command: one message for the user, and an exit code."""

from __future__ import annotations

import errno
import functools
import os
import tempfile
import traceback
from collections.abc import Callable
from typing import ParamSpec

import typer
from rich.console import Console

from gimpmd_schemas.errors import STOPPED, GimpmdError, StorageError

P = ParamSpec("P")

_STORAGE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
"""Errors of a disk that takes no more."""


def report_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Turn exceptions of a command into a message and an exit code.

    The traceback of an internal error goes to a file, which the message names. SIGTERM counts as
    Ctrl-C: see `app.main`.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except GimpmdError as error:
            print_error(str(error))
            raise typer.Exit(error.exit_code) from None
        except (typer.Exit, typer.Abort):
            raise
        except KeyboardInterrupt:
            print_error("interrupted")
            raise typer.Exit(STOPPED) from None
        except Exception as error:
            if isinstance(error, OSError) and error.errno in _STORAGE:
                where = f"{error.filename}: " if error.filename else ""
                print_error(f"{where}cannot be written: {os.strerror(error.errno)}")
                raise typer.Exit(StorageError.exit_code) from None
            print_error(f"internal error: {error!r}; {_keep_traceback()}")
            raise typer.Exit(GimpmdError.exit_code) from None

    return wrapped


def _keep_traceback() -> str:
    """Write the traceback of the present error to a file; say where it is."""
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="gimpmd-error-", suffix=".log", delete=False
        ) as log:
            traceback.print_exc(file=log)
    except OSError as error:
        return f"the traceback cannot be written: {error.strerror}"
    return f"the traceback is in {log.name}"


def print_error(message: str) -> None:
    """Print an error on standard error."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(f"error: {message}", style="red" if console.is_terminal else "", markup=False)
