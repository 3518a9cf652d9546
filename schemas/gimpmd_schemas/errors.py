"""The one hierarchy of errors. Every message tells the user the next step."""

from __future__ import annotations

import reprlib
from dataclasses import dataclass

_shorten = reprlib.Repr()  # long values are shortened
_shorten.maxlevel = 3
_shorten.maxstring = _shorten.maxother = _shorten.maxlong = 80


class GimpmdError(Exception):
    """Base of all errors that gimpmd raises on purpose.

    Attributes
    ----------
    exit_code : int
        What the process that dies of this error returns: 2 for bad input, 3 for a lost or
        failed service or results that cannot be written, 4 for a defect that ended the run.
    """

    exit_code = 3


STOPPED = 5
"""Exit code of a run that was asked to stop, and did so before its end. It is no error."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong with an input file: where it is, what is there, and the way out."""

    key: str
    value: object
    message: str
    hint: str = ""

    def __str__(self) -> str:
        shown = "" if self.value is None else f" = {_shorten.repr(self.value)}"
        hint = f"\n      {self.hint}" if self.hint else ""
        return f"{self.key}{shown}: {self.message}{hint}"


class InputError(GimpmdError):
    """The user's input cannot be run; all problems found are listed, not only the first."""

    exit_code = 2

    def __init__(self, file: str, problems: list[Problem]) -> None:
        self.file = file
        self.problems = problems
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        lines = "\n".join(f"  - {problem}" for problem in problems)
        super().__init__(f"{file}: {count}\n{lines}")


class BackendError(GimpmdError):
    """A backend (LAMMPS, GIMP) refused its input; carries the backend's own words."""

    exit_code = 2


class ProtocolError(GimpmdError):
    """A message broke the contract: version, run, step, case or layout do not match."""


class RefusedError(ProtocolError):
    """The coupler refused a service at registration; the reason is the message."""


class DefectError(GimpmdError):
    """A monitor found that the results are not reliable, and the case asks to stop the run then."""

    exit_code = 4


class PeerLostError(GimpmdError):
    """A service or the coupler died or fell silent; the message names the one that did."""


class StorageError(GimpmdError):
    """Results cannot be written: the disk is full or read-only, or the run folder was deleted."""
