"""Atomic strain of a LAMMPS dump: the MD service computes it and answers with a summary."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec

from gimpmd_deploy.launch.processes import ENVIRONMENT, mpiexec
from gimpmd_schemas.errors import BackendError, InputError, PeerLostError, Problem
from gimpmd_schemas.wire.answers import StrainSummary


def default_output(dump: Path) -> Path:
    """``atoms.strain.dump`` for ``atoms.dump``, in the same folder; never compressed."""
    name = dump.name.removesuffix(".gz")
    stem, dot, ending = name.rpartition(".")
    return dump.with_name(f"{stem}.strain.{ending}" if dot else f"{name}.strain")


def strain_of_dump(
    dump: Path, out: Path, options: Mapping[str, object | None], ranks: int, force: bool
) -> StrainSummary:
    """Write a copy of a dump with the strain of its atoms.

    Parameters
    ----------
    dump, out : Path
    options : mapping
        Options of ``gimpmd-md strain`` by name; None leaves the choice to the service.
    ranks : int
        MPI ranks that share the atoms.
    force : bool
        Whether ``out`` may be overwritten.

    Raises
    ------
    InputError
        ``out`` exists already.
    BackendError
        The service refused the dump or an option; the error is its own message.
    PeerLostError
        The service crashed.
    """
    if os.path.lexists(out) and not force:
        hint = "choose another with --out, or overwrite it with --force"
        raise InputError(str(out), [Problem("--out", None, "exists already", hint)])
    command = [mpiexec(), "-n", str(ranks)] if ranks > 1 else []
    command += [sys.executable, "-m", "gimpmd_md.service", "strain", str(dump), "--out", str(out)]
    for name, value in options.items():
        if value is not None:
            command.append(f"--{name}={value}")  # one word: a value may begin with a dash
    done = subprocess.run(
        command,
        env=os.environ | ENVIRONMENT,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    said = done.stderr.strip()
    if done.returncode == 2:
        raise BackendError(said.removeprefix("gimpmd-md: "))
    if done.returncode != 0:
        last = said.splitlines()[-1] if said else "it gave no reason"
        raise PeerLostError(
            f"{dump}: the MD service ended with exit code {done.returncode}: {last}"
        )
    return msgspec.json.decode(done.stdout.strip().splitlines()[-1], type=StrainSummary)
