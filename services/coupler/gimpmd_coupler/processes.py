"""Processes of ranks: which of them run on this machine, and whether they still run."""

from __future__ import annotations

import socket

import psutil

from gimpmd_schemas.wire.messages import Member, Register


class Processes:
    """The processes of the ranks that have registered from this machine."""

    def __init__(self) -> None:
        self._known: dict[Member, psutil.Process] = {}

    def look_up(self, member: Member, register: Register) -> None:
        """Remember the process of a rank if it runs on this machine."""
        if register.host == socket.gethostname() and psutil.pid_exists(register.pid):
            self._known[member] = psutil.Process(register.pid)

    def is_running(self, member: Member) -> bool:
        """Whether the process of a rank still runs; True where this is unknown."""
        process = self._known.get(member)
        if process is None:
            return True
        try:
            return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return False

    def state(self, member: Member) -> str:
        """Describe the process of a rank that has registered, for messages: ``it is remote``."""
        process = self._known.get(member)
        if process is None:
            return "it is remote"
        if not self.is_running(member):
            return f"its process {process.pid} is gone"
        return f"its process {process.pid} is {process.status()}"
