"""The built-in body of the checks, as a plan."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from gimpmd_deploy.check.cases import STRIP, Checkup, prepare
from gimpmd_schemas.case.plan import Plan


@cache
def strip_plan() -> Plan:
    """The strip for a continuum service: springs between nearest neighbours."""
    with TemporaryDirectory() as folder:
        return prepare(STRIP, Checkup("continuum"), False, Path(folder) / "strip")
