"""Errors of a command: one message for the user, and an exit code."""

from __future__ import annotations

import functools
import tempfile
import traceback
from collections.abc import Callable
from typing import ParamSpec

import typer
from rich.console import Console

from gimpmd_schemas.errors import GimpmdError

P = ParamSpec("P")


def report_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Turn exceptions of a command into a message and an exit code.

    The traceback of an internal error goes to a file, which the message names.
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
        except Exception as error:
            with tempfile.NamedTemporaryFile(
                "w", prefix="gimpmd-error-", suffix=".log", delete=False
            ) as log:
                traceback.print_exc(file=log)
            print_error(f"internal error: {error!r}; the traceback is in {log.name}")
            raise typer.Exit(3) from None

    return wrapped


def print_error(message: str) -> None:
    """Print an error on standard error."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(f"error: {message}", style="red" if console.is_terminal else "", markup=False)
