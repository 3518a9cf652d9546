"""Keys of a run."""

import datetime
import ipaddress
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID

from gimpmd_deploy.launch.keys import new_keys
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.access import ROLES


def read(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_the_authority_of_the_run_signs_all_members(tmp_path):
    folder = tmp_path / "keys"
    ranks: dict[Role, int] = {"md": 2, "continuum": 1}
    new_keys(folder, ["node7", "10.0.0.7"], ranks, days=3)
    authority = read(folder / "authority.pem")
    for member in ("coupler", "md/0", "md/1", "continuum/0"):
        made = read(folder / f"{member.replace('/', '-')}.pem")
        made.verify_directly_issued_by(authority)
        (name,) = made.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert name.value == member
        left = made.not_valid_after_utc - datetime.datetime.now(datetime.UTC)
        assert datetime.timedelta(days=2) < left < datetime.timedelta(days=3)
    assert len([*folder.glob("*.pem")]) == 5  # and no further ranks
    assert len({path.read_bytes() for path in folder.glob("*.key")}) == 4
    names = read(folder / "coupler.pem").extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    assert names.value.get_values_for_type(x509.DNSName) == ["node7"]
    assert names.value.get_values_for_type(x509.IPAddress) == [ipaddress.ip_address("10.0.0.7")]


def test_only_the_owner_can_read_them_and_all_are_new(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        new_keys(folder, ["localhost"])
        assert folder.stat().st_mode & 0o777 == 0o700
        for file in folder.iterdir():
            assert file.stat().st_mode & 0o777 == 0o600
    for file in one.iterdir():
        assert file.read_bytes() != (other / file.name).read_bytes()
    users = dict(line.split(":") for line in (one / "users").read_text().split())
    for role in ROLES:
        assert (one / f"{role}.password").read_text().strip() == users[role]
        assert len(users[role]) > 40
    assert not (one / "authority.key").exists()  # nobody can sign another certificate


def test_an_old_folder_is_left_alone(tmp_path):
    with pytest.raises(InputError, match="cannot be made: File exists"):
        new_keys(tmp_path, ["localhost"])
    assert not any(tmp_path.iterdir())
