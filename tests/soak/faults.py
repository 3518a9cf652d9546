"""Faults that are injected into a run: what is done, and what can be undone."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from gimpmd_schemas.checkpoint.manifest import FOLDER, committed, folder_of
from gimpmd_schemas.on_disk import write_at_once
from tests.running import Running

FROZEN_SECONDS = 8.0
"""Longer than the lease of a connection and the time in which it may come back."""

DISK_FULL, READ_ONLY, CLOCK_JUMPS = "disk full", "run folder read-only", "clock jumps"

DISK_SIZE = "512m"

CLOCK = "clock.txt"
"""File beside the run folder with the seconds by which the clock of a run is wrong."""

WRONG_CLOCK = Path(__file__).with_name("clock.c")


@dataclass(frozen=True)
class Scene:
    """A run into which a fault is injected.

    Attributes
    ----------
    run : the run, which goes on.
    chance : random numbers.
    undo : what ends the fault before the run goes on.
    """

    run: Running
    chance: random.Random
    undo: ExitStack

    @property
    def folder(self) -> Path:
        """The run folder."""
        return self.run.folder

    def pick(self, word: str) -> psutil.Process | None:
        """One of the processes of the run with a word in its command line."""
        if word == "launcher":
            return self.run.launcher
        found = self.run.processes(word)
        return self.chance.choice(found) if found else None


Fault = Callable[[Scene], bool]
"""Injects a fault; returns whether it could."""


def kill(word: str) -> Fault:
    """``kill -9`` of a process."""

    def inject(scene: Scene) -> bool:
        process = scene.pick(word)
        if process is not None:
            process.send_signal(signal.SIGKILL)
        return process is not None

    return inject


def kill_all(scene: Scene) -> bool:
    """All processes end at once, as when the power fails."""
    children = scene.run.family()
    for process in (scene.run.launcher, *children):
        with suppress(psutil.NoSuchProcess):
            process.send_signal(signal.SIGKILL)
    psutil.wait_procs(children, timeout=30)  # the launcher belongs to who has started it
    return True


def freeze(word: str) -> Fault:
    """A process that stands still for a while."""

    def inject(scene: Scene) -> bool:
        process = scene.pick(word)
        if process is None:
            return False
        process.send_signal(signal.SIGSTOP)
        time.sleep(FROZEN_SECONDS)
        if process.is_running():
            process.send_signal(signal.SIGCONT)
        return True

    return inject


def terminate(scene: Scene) -> bool:
    """SIGTERM to the launcher, as batch systems send it."""
    scene.run.launcher.send_signal(signal.SIGTERM)
    return True


def spoil(way: str) -> Fault:
    """Kill all processes, then damage a file of the last checkpoint."""

    def inject(scene: Scene) -> bool:
        kill_all(scene)
        found = committed(scene.folder)
        if len(found) < 2:
            return True
        files = sorted(folder_of(scene.folder, found[0].step).glob("*.h5"))
        path = scene.chance.choice(files)
        data = bytearray(path.read_bytes())
        if way == "shorten":
            path.write_bytes(data[: scene.chance.randrange(len(data))])
        elif way == "remove":
            path.unlink()
        else:
            data[scene.chance.randrange(len(data))] ^= 1 << scene.chance.randrange(8)
            path.write_bytes(data)
        return True

    return inject


def half_a_checkpoint(scene: Scene) -> bool:
    """Kill all processes, then leave a later checkpoint without its manifest."""
    kill_all(scene)
    found = committed(scene.folder)
    if found:
        shutil.copytree(
            folder_of(scene.folder, found[0].step),
            scene.folder / FOLDER / "1000",
            ignore=shutil.ignore_patterns("manifest.json"),
        )
    return True


def remove_folder(scene: Scene) -> bool:
    """The run folder is gone."""
    if not scene.folder.exists():
        return False
    scene.folder.rename(scene.folder.with_name("gone"))
    shutil.rmtree(scene.folder.with_name("gone"))
    return True


def less_memory(word: str) -> Fault:
    """A process may have hardly more memory than it has now."""

    def inject(scene: Scene) -> bool:
        process = scene.pick(word)
        if process is None:
            return False
        limit = process.memory_info().vms + 2**20
        process.rlimit(psutil.RLIMIT_AS, (limit, limit))
        return True

    return inject


def fill_disk(scene: Scene) -> bool:
    """The disk of the run has no space left."""
    disk = str(scene.folder.parents[1])
    # while the run writes, more may be in use than a moment ago
    _try_often(lambda: _remount(disk, f"size={_used(disk)}"))
    scene.undo.callback(_mount, "-o", f"remount,size={DISK_SIZE}", disk)
    return True


def read_only_folder(scene: Scene) -> bool:
    """No file can be made or opened for writing in the run folder; open files go on."""
    if not scene.folder.exists():
        return False
    folder = str(scene.folder)
    _mount("--bind", folder, folder)
    scene.undo.callback(_unmount, folder)
    # a file that the run has opened since is in the way
    _try_often(lambda: _remount(folder, "bind,ro"))
    return True


def set_clock(scene: Scene) -> bool:
    """The clock jumps by up to a day, forwards or backwards."""
    seconds = scene.chance.randrange(-86400, 86400)
    write_at_once(scene.folder.with_name(CLOCK), f"{seconds}\n".encode())
    return True


@contextmanager
def disk(folder: Path) -> Iterator[None]:
    """Make a folder a disk of its own while the context lasts."""
    _mount("-t", "tmpfs", "-o", f"size={DISK_SIZE}", "tmpfs", str(folder))
    try:
        yield
    finally:
        _unmount(str(folder))


def _mount(*words: str) -> None:
    subprocess.run(["mount", *words], check=True)


def _remount(folder: str, options: str) -> bool:
    """Change the options of a mount; false if what the run does just now is in the way."""
    words = ["mount", "-o", f"remount,{options}", folder]
    return subprocess.run(words, stderr=subprocess.DEVNULL, check=False).returncode == 0


def _try_often(attempt: Callable[[], bool]) -> None:
    if not any(attempt() for _ in range(100)):
        raise RuntimeError("the fault could not be injected")


def _used(disk: str) -> int:
    """Bytes of a disk that are in use."""
    state = os.statvfs(disk)
    return (state.f_blocks - state.f_bfree) * state.f_frsize


def _unmount(folder: str) -> None:
    subprocess.run(["umount", "--lazy", folder], check=True)


def with_clock(clock: Path) -> dict[str, str]:
    """Variables of the environment of a run whose clock is wrong by the seconds in a file."""
    clock.write_text("0\n")
    library = clock.with_name("clock.so")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, WRONG_CLOCK, "-ldl"], check=True)
    return {"LD_PRELOAD": str(library), "CLOCK_FILE": str(clock)}


def _lost(who: str) -> str:
    return rf"\b{who}(/\d+)?( was lost|: )"


FAULTS: dict[str, Fault] = {
    "kill -9 an MD rank": kill("gimpmd_md"),
    "kill -9 mpiexec": kill("mpiexec"),
    "kill -9 the continuum": kill("gimpmd_gimp"),
    "kill -9 the coupler": kill("gimpmd_coupler"),
    "kill -9 the launcher": kill("launcher"),
    "kill -9 all processes": kill_all,
    "freeze an MD rank": freeze("gimpmd_md"),
    "freeze the continuum": freeze("gimpmd_gimp"),
    "freeze the coupler": freeze("gimpmd_coupler"),
    "freeze the launcher": freeze("launcher"),
    "SIGTERM to the launcher": terminate,
    "checkpoint altered": spoil("alter"),
    "checkpoint shortened": spoil("shorten"),
    "file of a checkpoint removed": spoil("remove"),
    "checkpoint without manifest": half_a_checkpoint,
    "run folder deleted": remove_folder,
    "memory limit of an MD rank": less_memory("gimpmd_md"),
    "memory limit of the continuum": less_memory("gimpmd_gimp"),
    "memory limit of the coupler": less_memory("gimpmd_coupler"),
    DISK_FULL: fill_disk,
    READ_ONLY: read_only_folder,
    CLOCK_JUMPS: set_clock,
}


CAUSES = {
    "an MD rank": _lost("md") + "|the MD service ended",  # or the probe before the run
    "mpiexec": _lost("md"),
    "the continuum": _lost("(continuum|gimp)"),
    "the coupler": _lost("coupler"),
    "run folder deleted": r"was deleted|no such folder|No such file",
    DISK_FULL: "No space left on device",
    READ_ONLY: "Read-only file system",
}
"""What a run that was disturbed must say, by the end of the name of the fault."""


def names_cause(name: str, text: str) -> bool:
    """Whether a run that a fault has ended or set back says what it was.

    If the launcher itself is killed, nobody is left to say it.
    """
    words = " ".join(text.split())
    return all(re.search(said, words) for end, said in CAUSES.items() if name.endswith(end))


def missing(name: str) -> str:
    """What this machine lacks for a fault; empty if it lacks nothing."""
    if name in (DISK_FULL, READ_ONLY) and os.geteuid() != 0:
        return "root"
    if name == CLOCK_JUMPS and not shutil.which("cc"):
        return "a C compiler"
    return ""
