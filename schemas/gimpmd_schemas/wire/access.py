"""Where services meet, and the files with the keys that let them in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from gimpmd_schemas.case.form import Role

UNIX, TLS = "unixsock-stream", "tls"
"""What endpoints begin with: a Unix socket on one host; TLS between hosts."""

COUPLER = "coupler"
"""Common name of the coupler's certificate; that of a rank is its name, such as ``md/0``."""

ROLES: tuple[Role, ...] = get_args(Role)

ONE_EACH: Mapping[Role, int] = dict.fromkeys(ROLES, 1)
"""Numbers of ranks of a run with one rank on each side."""

KEYS = "keys"
"""Folder of the keys, in the run folder."""

AUTHORITY = "authority.pem"
"""Certificate of the authority of the run; its key is thrown away when all have certificates."""

USERS = "users"
"""Roles and passwords, one ``role:password`` a line; the coupler's."""


def names(ranks: Mapping[Role, int]) -> list[str]:
    """Common names of the certificates of all ranks."""
    return [f"{role}/{rank}" for role in ROLES for rank in range(ranks.get(role, 0))]


def certificate(name: str) -> str:
    """Name of the file with the certificate of the coupler or of a rank, by its common name."""
    return f"{name.replace('/', '-')}.pem"


def private_key(name: str) -> str:
    """Name of the file with the private key of the coupler or of a rank."""
    return f"{name.replace('/', '-')}.key"


def password(role: Role) -> str:
    """Name of the file with the password of a role."""
    return f"{role}.password"
