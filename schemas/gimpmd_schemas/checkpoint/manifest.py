"""Checkpoints in a run folder: ``checkpoints/<step>/`` with a file of each rank and a manifest.

A checkpoint counts only if it has a manifest. The coupler writes the manifest last, when the files
of all ranks are on disk, and gives it its name in one step. So a checkpoint is whole, or it is not
there.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated

import msgspec

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import GimpmdError, InputError, Problem
from gimpmd_schemas.on_disk import sync, write_at_once

FOLDER = "checkpoints"
MANIFEST = "manifest.json"
RECORD = "run.h5"
"""Copy of the record of the run, with at least the steps before the checkpoint."""


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What belongs to a checkpoint.

    Attributes
    ----------
    step : coupling step at which the ranks have saved their states.
    time : time of that step (time units).
    state : digest of what a plan must have in common with the one that wrote it
        (`Plan.state_digest`).
    ranks : number of ranks of each role.
    start_energy : energy of the whole body at the start of the run; null if none is known yet.
    files : SHA-256 of each file, by name, in hex.
    """

    step: Annotated[int, msgspec.Meta(ge=0)]
    time: float
    state: str
    ranks: dict[Role, int]
    start_energy: float | None
    files: dict[str, str]


def folder_of(run_dir: Path, step: int) -> Path:
    """Folder of the checkpoint of a step."""
    return run_dir / FOLDER / str(step)


def state_file(role: Role, rank: int) -> str:
    """Name of the file with the state of a rank."""
    return f"{role}.{rank}.h5"


def committed(run_dir: Path) -> list[Manifest]:
    """All checkpoints of a run that have a manifest, the latest one first.

    Raises
    ------
    InputError
        A manifest cannot be read.
    """
    steps = [int(path.name) for path in (run_dir / FOLDER).glob("[0-9]*") if path.name.isdigit()]
    found = []
    for step in sorted(steps, reverse=True):
        path = folder_of(run_dir, step) / MANIFEST
        if path.exists():
            found.append(_read(path))
    return found


def _read(path: Path) -> Manifest:
    try:
        return msgspec.json.decode(path.read_bytes(), type=Manifest)
    except (OSError, msgspec.DecodeError) as error:
        raise InputError(
            str(path),
            [Problem("manifest", None, str(error), f"rename {path.parent} to leave it out")],
        ) from error


def write_manifest(run_dir: Path, manifest: Manifest) -> None:
    """Make a checkpoint count: write its manifest, then give it its name in one step.

    Raises
    ------
    OSError
        The disk is full, or the folder is gone.
    """
    folder = folder_of(run_dir, manifest.step)
    write_at_once(folder / MANIFEST, msgspec.json.encode(manifest))
    sync(folder.parent)


def damage(run_dir: Path, manifest: Manifest) -> str:
    """Say which file of a checkpoint is missing or altered; an empty text if it is whole."""
    found = (_damage_of(run_dir, manifest, name) for name in manifest.files)
    return next(filter(None, found), "")


def check_whole(run_dir: Path, manifest: Manifest, name: str) -> Path:
    """Return the path of a file of a checkpoint whose content is that of the manifest.

    Raises
    ------
    GimpmdError
        The file is missing, altered, or not part of the checkpoint.
    """
    if reason := _damage_of(run_dir, manifest, name):
        raise GimpmdError(f"{reason}; resume from an older checkpoint")
    return folder_of(run_dir, manifest.step) / name


def _damage_of(run_dir: Path, manifest: Manifest, name: str) -> str:
    """Say what is wrong with a file of a checkpoint; an empty text if nothing is."""
    path = folder_of(run_dir, manifest.step) / name
    if not path.is_file() or name not in manifest.files:
        return f"{path} is missing: the checkpoint has no such file"
    if digest_of(path) != manifest.files[name]:
        return f"{path} is damaged"
    return ""


def digest_of(path: Path) -> str:
    """SHA-256 of a file, in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
