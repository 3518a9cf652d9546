"""A run whose services are started by hand: where they meet, and the commands that start them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gimpmd_deploy.launch.keys import new_keys
from gimpmd_deploy.launch.services import NAMES, foreign_program, rank_words, run_words
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.wire.access import KEYS, ONE_EACH, TLS, UNIX

PATIENCE = 600.0
"""Seconds for which ranks wait for the coupler, so the commands can be given in any order."""

BUS = "bus"
"""Folder of the socket, in the run folder."""


def host_of(listen: str) -> str:
    """Return the host in ``HOST:PORT``.

    Raises
    ------
    InputError
        The text has another form.
    """
    host, _, port = listen.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        hint = "give the name under which the other hosts reach this one, as in node7:7447"
        raise InputError("gimpmd", [Problem("--listen", listen, "is not HOST:PORT", hint)])
    return host.strip("[]")


def meeting_place(folder: Path, listen: str | None, ranks: Mapping[Role, int] = ONE_EACH) -> str:
    """Make what the services need to meet, and return the endpoint of the coupler.

    Parameters
    ----------
    folder : Path
        The run folder.
    listen : str or None
        ``HOST:PORT`` for TLS, with keys that are made in the run folder. Without it, a Unix socket
        in the run folder.
    ranks : mapping
        Number of ranks of each role, who all get keys.

    Raises
    ------
    InputError
        The text has another form, or the name of the socket would be too long.
    """
    folder = folder.absolute()
    if listen is not None:
        new_keys(folder / KEYS, [host_of(listen)], ranks)
        return f"{TLS}/{listen}"
    (folder / BUS).mkdir(mode=0o700, exist_ok=True)  # an earlier attempt may have left it
    return f"{UNIX}/{folder / BUS / 'socket'}"


def commands(plan: Plan, folder: Path, run: str, endpoint: str) -> dict[str, list[str]]:
    """Return the words of the commands that start the services, by name.

    Parameters
    ----------
    plan : Plan
    folder : Path
        The run folder.
    run : str
        The run id.
    endpoint : str
        See `meeting_place`.
    """
    found = {"coupler": ["gimpmd-coupler", *run_words(folder, run), "--listen", endpoint]}
    for role in plan.roles:
        words = rank_words(role, folder, run, endpoint)
        program = foreign_program(plan, NAMES[role]) or (f"gimpmd-{NAMES[role]}",)
        found[NAMES[role]] = [*program, *words, "--patience", f"{PATIENCE:g}"]
    return found
