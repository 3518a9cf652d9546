"""Keys of a run: an authority of its own, certificates of coupler and ranks, passwords of roles."""

from __future__ import annotations

import datetime
import ipaddress
import os
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.wire.access import (
    AUTHORITY,
    COUPLER,
    ONE_EACH,
    ROLES,
    USERS,
    certificate,
    names,
    password,
    private_key,
)

DAYS = 30
"""Days for which keys are valid, if nothing else is asked for."""

_CURVE = ec.SECP256R1()
_EARLIER = datetime.timedelta(hours=1)  # clocks of hosts differ


def new_keys(
    folder: Path,
    hosts: Sequence[str],
    ranks: Mapping[Role, int] = ONE_EACH,
    days: int = DAYS,
) -> None:
    """Make the keys of one run in a new folder that only its owner may enter.

    The authority's own key is not kept, so no further certificate can be made for this run.

    Parameters
    ----------
    folder : Path
        Must not exist.
    hosts : sequence of str
        Names and addresses under which ranks reach the coupler.
    ranks : mapping
        Number of ranks of each role.
    days : int
        How long the keys are valid.

    Raises
    ------
    InputError
        The folder exists or cannot be made.
    """
    try:
        folder.mkdir(mode=0o700, parents=True)
    except OSError as error:
        hint = "choose another folder, or remove it if its keys are no longer used"
        problem = Problem("folder", None, f"cannot be made: {error.strerror}", hint)
        raise InputError(str(folder), [problem]) from None
    authority_key = ec.generate_private_key(_CURVE)
    authority = _sign(_subject("gimpmd run"), authority_key, None, (), days)
    _write(folder / AUTHORITY, _pem(authority))
    for name in (COUPLER, *names(ranks)):
        key = ec.generate_private_key(_CURVE)
        issuer = authority, authority_key
        made = _sign(_subject(name), key, issuer, hosts if name == COUPLER else (), days)
        _write(folder / certificate(name), _pem(made))
        _write(folder / private_key(name), _pem_of_key(key))
    words = {role: secrets.token_urlsafe(32) for role in ROLES}
    for role, word in words.items():
        _write(folder / password(role), f"{word}\n".encode())
    _write(folder / USERS, "".join(f"{role}:{word}\n" for role, word in words.items()).encode())


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _sign(
    subject: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    issuer: tuple[x509.Certificate, ec.EllipticCurvePrivateKey] | None,
    hosts: Sequence[str],
    days: int,
) -> x509.Certificate:
    """Return a certificate: of the coupler if it has hosts, else of a rank.

    Without an issuer it is an authority's, signed by itself.
    """
    now = datetime.datetime.now(datetime.UTC)
    signer, signing_key = (subject, key) if issuer is None else (issuer[0].subject, issuer[1])
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(signer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _EARLIER)
        .not_valid_after(now + datetime.timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=issuer is None, path_length=None), critical=True)
    )
    if hosts:
        known = [_host_name(host) for host in hosts]
        builder = builder.add_extension(x509.SubjectAlternativeName(known), critical=False)
    if issuer is not None:
        uses = ExtendedKeyUsageOID
        use = uses.SERVER_AUTH if hosts else uses.CLIENT_AUTH
        builder = builder.add_extension(x509.ExtendedKeyUsage([use]), critical=False)
    return builder.sign(signing_key, hashes.SHA256())


def _host_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(made: x509.Certificate) -> bytes:
    return made.public_bytes(serialization.Encoding.PEM)


def _pem_of_key(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _write(path: Path, data: bytes) -> None:
    """Write a new file that only its owner can read."""
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)
