"""Checkpoints of a run: when they are due, and when one is whole.

Each rank writes its own state and reports the digest of its file. When all have done so, and all
earlier steps are in the record of the run, the manifest is written. Only then does the checkpoint
count.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterable
from pathlib import Path

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.manifest import (
    FOLDER,
    RECORD,
    Manifest,
    committed,
    digest_of,
    folder_of,
    state_file,
    write_manifest,
)
from gimpmd_schemas.on_disk import sync
from gimpmd_schemas.wire.messages import Member, Saved

log = logging.getLogger(__name__)


class Checkpoints:
    """Checkpoints in a run folder.

    Parameters
    ----------
    run_dir : Path
    plan : Plan
    now : float
        Time on a steady clock (seconds).
    """

    def __init__(self, run_dir: Path, plan: Plan, now: float) -> None:
        self._run_dir, self._plan = run_dir, plan
        self._ranks: dict[Role, int] = {role: plan.ranks(role) for role in plan.roles}
        self._saved: dict[int, dict[Member, str]] = {}  # digests by step
        self._ordered, self._ordered_at = -1, now

    def due(self, now: float) -> bool:
        """Whether it is time to order a checkpoint, and none is on its way."""
        wanted = self._plan.checkpoint
        if wanted is None or wanted.seconds is None or self._ordered >= 0:
            return False
        return now - self._ordered_at >= wanted.seconds

    def note_order(self, step: int, now: float) -> None:
        """Note that a checkpoint has been ordered."""
        self._ordered, self._ordered_at = step, now

    def note_saved(self, member: Member, saved: Iterable[Saved]) -> None:
        """Note that a rank has saved its state."""
        for one in saved:
            self._saved.setdefault(one.step, {})[member] = one.digest

    def ready(self, recorded: int) -> list[int]:
        """Steps that all ranks have saved, with all earlier steps recorded up to ``recorded``."""
        return [
            step
            for step, digests in sorted(self._saved.items())
            if len(digests) == sum(self._ranks.values()) and step <= recorded + 1
        ]

    def commit(self, step: int, start_energy: float | None, record: Path) -> None:
        """Make a checkpoint count, and remove those that are older than the case keeps.

        Parameters
        ----------
        step : int
            One of `ready`.
        start_energy : float or None
            Energy of the whole body at the start of the run.
        record : Path
            ``run.h5``, flushed.

        Raises
        ------
        OSError
            The disk is full, or the folder is gone.
        """
        folder = folder_of(self._run_dir, step)
        files = {
            state_file(role, rank): digest for (role, rank), digest in self._saved.pop(step).items()
        }
        copy = folder / RECORD
        shutil.copyfile(record, copy)
        sync(copy)
        files[RECORD] = digest_of(copy)
        manifest = Manifest(
            step=step,
            time=step * self._plan.step,
            state=self._plan.state_digest(),
            ranks=self._ranks,
            start_energy=start_energy,
            files=files,
        )
        write_manifest(self._run_dir, manifest)
        if step == self._ordered:
            self._ordered = -1
        log.info("checkpoint of step %d", step)
        self._remove_old()

    def _remove_old(self) -> None:
        keep = self._plan.checkpoint.keep if self._plan.checkpoint else 1
        oldest = min(one.step for one in committed(self._run_dir)[:keep])
        for path in (self._run_dir / FOLDER).iterdir():
            if path.name.isdigit() and int(path.name) < oldest:
                shutil.rmtree(path)
