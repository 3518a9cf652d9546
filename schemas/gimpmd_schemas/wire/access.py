"""Where services meet, and the files with the keys that let them in."""

from __future__ import annotations

from typing import Literal, get_args

from gimpmd_schemas.case.form import Role

UNIX, TLS = "unixsock-stream", "tls"
"""What endpoints begin with: a Unix socket on one host; TLS between hosts."""

Member = Literal["coupler", "md", "continuum"]
MEMBERS: tuple[Member, ...] = get_args(Member)
ROLES: tuple[Role, ...] = get_args(Role)

KEYS = "keys"
"""Folder of the keys, in the run folder."""

AUTHORITY = "authority.pem"
"""Certificate of the authority of the run; its key is thrown away when all have certificates."""

USERS = "users"
"""Roles and passwords, one ``role:password`` a line; the coupler's."""


def certificate(member: Member) -> str:
    """Name of the file with the certificate of a member."""
    return f"{member}.pem"


def private_key(member: Member) -> str:
    """Name of the file with the private key of a member."""
    return f"{member}.key"


def password(role: Role) -> str:
    """Name of the file with the password of a role."""
    return f"{role}.password"
