"""Keys with which the coupler and the ranks recognise one another beyond one host.

A folder of keys belongs to one run. Each member (the coupler, and each role) has a certificate and
a password. The router accepts a connection only with a certificate of the run's own authority and
the password of the same member, and it lets a role use only the keys of the bus that are its own.
"""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Any

from gimpmd_coupler.bus.settings import KINDS
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.wire.access import (
    AUTHORITY,
    ROLES,
    USERS,
    certificate,
    password,
    private_key,
)


def router_settings(folder: Path, start: str) -> dict[str, Any]:
    """Return settings of a router that lets in the ranks of one run, each with its own rights.

    Parameters
    ----------
    folder : Path
        The keys.
    start : str
        What all keys of the run on the bus begin with.

    Raises
    ------
    InputError
        A file is missing, or other users can read it.
    """
    return {
        "transport/link/tls": {
            "root_ca_certificate": _file(folder, AUTHORITY),
            "listen_certificate": _file(folder, certificate("coupler")),
            "listen_private_key": _file(folder, private_key("coupler"), secret=True),
            "enable_mtls": True,
            "close_link_on_expiration": True,
        },
        "transport/auth/usrpwd/dictionary_file": _file(folder, USERS, secret=True),
        "access_control": _rights(start),
    }


def rank_settings(folder: Path, role: Role) -> dict[str, Any]:
    """Return settings of a rank's session.

    Raises
    ------
    InputError
        A file is missing, or other users can read it.
    """
    word = Path(_file(folder, password(role), secret=True)).read_text(encoding="ascii").strip()
    return {
        "transport/link/tls": {
            "root_ca_certificate": _file(folder, AUTHORITY),
            "connect_certificate": _file(folder, certificate(role)),
            "connect_private_key": _file(folder, private_key(role), secret=True),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        },
        "transport/auth/usrpwd/user": role,
        "transport/auth/usrpwd/password": word,
    }


def _file(folder: Path, name: str, secret: bool = False) -> str:
    path = folder / name
    if not path.is_file():
        hint = f"make keys with: gimpmd keys new {folder}"
        raise InputError(str(folder), [Problem(name, None, "there is no such file", hint)])
    mode = path.stat().st_mode
    if secret and mode & (stat.S_IRWXG | stat.S_IRWXO):
        hint = f"chmod 600 {path}, and make new keys if somebody may have read it"
        problem = Problem(name, stat.filemode(mode), "other users can read this secret", hint)
        raise InputError(str(folder), [problem])
    return str(path)


def _rights(start: str) -> dict[str, Any]:
    """Access control: each role may use its own keys of the bus, and nobody else any."""
    rules: list[dict[str, Any]] = []
    subjects, policies = [], []
    for role, other in zip(ROLES, reversed(ROLES), strict=True):
        requests = [f"{start}/{kind}/{role}/*" for kind in KINDS]
        sent = [*requests, f"{start}/data/{role}/*", f"{start}/again/{other}/*"]
        taken = [f"{start}/answer/{role}/*", f"{start}/again/{role}/*", f"{start}/data/{other}/*"]
        # the router tells a publisher who subscribes: the coupler does so to requests of all ranks,
        # and to all payloads in a run that is recorded
        announced = [*sent, *(f"{start}/{kind}/*/*" for kind in (*KINDS, "data"))]
        mine = [
            {
                "id": f"{role} {flow} {message}",
                "permission": "allow",
                "flows": [flow],
                "messages": [message],
                "key_exprs": keys,
            }
            for flow, message, keys in (
                ("ingress", "put", sent),
                ("ingress", "declare_subscriber", taken),
                ("ingress", "liveliness_token", [f"{start}/alive/{role}/*"]),
                ("egress", "put", taken),
                ("egress", "declare_subscriber", announced),
            )
        ]
        rules += mine
        subjects.append({"id": role, "cert_common_names": [role], "usernames": [role]})
        policies.append({"rules": [rule["id"] for rule in mine], "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }
