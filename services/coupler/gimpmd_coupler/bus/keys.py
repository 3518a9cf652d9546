"""Keys with which the coupler and the ranks recognise one another beyond one host.

A folder of keys belongs to one run. The coupler and each rank have a certificate, and each role has
a password. The router accepts a connection only with a certificate of the run's own authority and
the password of its role, and it lets a rank use only the keys of the bus that are its own. Every
frame passes through the router. So the connection on which it comes proves who has sent it, and it
needs no signature.
"""

from __future__ import annotations

import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gimpmd_coupler.bus.settings import KINDS
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.wire.access import (
    AUTHORITY,
    COUPLER,
    ROLES,
    USERS,
    certificate,
    password,
    private_key,
)


def router_settings(folder: Path, start: str, ranks: Mapping[Role, int]) -> dict[str, Any]:
    """Return settings of a router that lets in the ranks of one run, each with its own rights.

    Parameters
    ----------
    folder : Path
        The keys.
    start : str
        What all keys of the run on the bus begin with.
    ranks : mapping
        Number of ranks of each role.

    Raises
    ------
    InputError
        A file is missing, or other users can read it.
    """
    return {
        "transport/link/tls": {
            "root_ca_certificate": _file(folder, AUTHORITY),
            "listen_certificate": _file(folder, certificate(COUPLER)),
            "listen_private_key": _file(folder, private_key(COUPLER), secret=True),
            "enable_mtls": True,
            "close_link_on_expiration": True,
        },
        "transport/auth/usrpwd/dictionary_file": _file(folder, USERS, secret=True),
        "access_control": _rights(start, ranks),
    }


def rank_settings(folder: Path, role: Role, rank: int) -> dict[str, Any]:
    """Return settings of a rank's session.

    Raises
    ------
    InputError
        A file is missing, or other users can read it.
    """
    name = f"{role}/{rank}"
    word = Path(_file(folder, password(role), secret=True)).read_text(encoding="ascii").strip()
    return {
        "transport/link/tls": {
            "root_ca_certificate": _file(folder, AUTHORITY),
            "connect_certificate": _file(folder, certificate(name)),
            "connect_private_key": _file(folder, private_key(name), secret=True),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        },
        "transport/auth/usrpwd/user": role,
        "transport/auth/usrpwd/password": word,
    }


def _file(folder: Path, name: str, secret: bool = False) -> str:
    path = folder / name
    if not path.is_file():
        hint = (
            f"copy it from where the keys were made; for a new run, gimpmd keys new {folder} makes "
            "keys for as many ranks as --ranks-md and --ranks-gimp say"
        )
        raise InputError(str(folder), [Problem(name, None, "there is no such file", hint)])
    mode = path.stat().st_mode
    if secret and mode & (stat.S_IRWXG | stat.S_IRWXO):
        hint = f"chmod 600 {path}, and make new keys if somebody may have read it"
        problem = Problem(name, stat.filemode(mode), "other users can read this secret", hint)
        raise InputError(str(folder), [problem])
    return str(path)


def _rights(start: str, ranks: Mapping[Role, int]) -> dict[str, Any]:
    """Access control: each rank may use its own keys of the bus, and nobody else any."""
    rules: list[dict[str, Any]] = []
    subjects, policies = [], []
    for role, other in zip(ROLES, reversed(ROLES), strict=True):
        members = [f"{role}/{rank}" for rank in range(ranks.get(role, 0))]
        if not members:
            continue
        of_role = _of_role(start, role, other)
        rules += of_role
        policies.append({"rules": _ids(of_role), "subjects": members})
        for name in members:
            mine = _of_rank(start, name)
            rules += mine
            subjects.append({"id": name, "cert_common_names": [name], "usernames": [role]})
            policies.append({"rules": _ids(mine), "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _of_role(start: str, role: Role, other: Role) -> list[dict[str, Any]]:
    """What all ranks of a role may do: take payloads of the other role, and ask for them again."""
    payloads, again = [f"{start}/data/{other}/*"], [f"{start}/again/{other}/*"]
    # the router tells a publisher who subscribes: the coupler does so to requests of all ranks, and
    # to all payloads in a run that is recorded
    announced = [*again, *(f"{start}/{kind}/*/*" for kind in (*KINDS, "data"))]
    allowed = (
        ("ingress", "put", again),
        ("ingress", "declare_subscriber", payloads),
        ("egress", "put", payloads),
        ("egress", "declare_subscriber", announced),
    )
    return [_allow(role, *what) for what in allowed]


def _of_rank(start: str, name: str) -> list[dict[str, Any]]:
    """What one rank alone may do: send in its name, and take what is meant for it."""
    sent = [f"{start}/{kind}/{name}" for kind in (*KINDS, "data")]
    taken = [f"{start}/{kind}/{name}" for kind in ("answer", "again")]
    allowed = (
        ("ingress", "put", sent),
        ("ingress", "declare_subscriber", taken),
        ("ingress", "liveliness_token", [f"{start}/alive/{name}"]),
        ("egress", "put", taken),
    )
    return [_allow(name, *what) for what in allowed]


def _allow(who: str, flow: str, message: str, keys: list[str]) -> dict[str, Any]:
    return {
        "id": f"{who} {flow} {message}",
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": keys,
    }


def _ids(rules: Iterable[dict[str, Any]]) -> list[str]:
    return [rule["id"] for rule in rules]
