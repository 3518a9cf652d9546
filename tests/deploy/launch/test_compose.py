"""Services from a compose file, without containers; a whole run is in tests/system."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from gimpmd_deploy.launch.compose import Described, describe
from gimpmd_deploy.launch.processes import Service
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import InputError
from tests.cases import CASE, changed
from tests.conftest import ROOT

OURS = ROOT / "deploy" / "compose.yaml"
SMALL: dict[str, Any] = {
    "services": {
        "coupler": {
            "entrypoint": "couple",
            "command": "--run-dir /inside",
            "volumes": ["/r:/inside"],
        },
        "md": {
            "entrypoint": ["mpiexec", "-n", "${RANKS_MD:-9}", "md"],
            "environment": {"A": "${NOT_THERE-none}", "B": "$$5"},
            "depends_on": ["coupler"],
        },
        "gimp": {
            "entrypoint": "gimp",
            "depends_on": {"coupler": {"condition": "service_healthy"}},
        },
    }
}


def case(changes: dict[str, Any] | None = None) -> Case:
    return msgspec.convert(changed(CASE, changes or {}), Case)


def words(service: Service) -> list[str]:
    """Without the search path."""
    first, path, *rest = service.argv
    assert first == "env"
    assert path.startswith("PATH=")
    return rest


def sides(described: Described) -> dict[str, list[str]]:
    return {service.name: words(service) for service in described.run.sides("anywhere")}


@pytest.fixture
def small(tmp_path: Path) -> Any:
    """Describe the small file with changes."""

    def describe_changed(changes: dict[str, Any]) -> Described:
        file = tmp_path / "compose.yaml"
        file.write_text(yaml.safe_dump(changed(SMALL, changes)))
        return describe(file, case(), tmp_path, tmp_path / "run")

    return describe_changed


def test_our_own_file(tmp_path: Path) -> None:
    folder = tmp_path / "a run"
    chosen = case({"md.ranks": 4, "continuum.ranks": 3})
    described = describe(OURS, chosen, Path("/cases/one"), folder)
    (prepare,) = described.first
    shell, option, script = words(prepare)
    assert (shell, option) == ("sh", "-c")
    assert f"gimpmd prepare /cases/one/case.yaml --out '{folder}'" in script
    assert "--ranks-md 4 --ranks-gimp 3" in script
    socket = f"unixsock-stream/{folder}/bus/socket"
    coupler = words(described.run.coupler)
    assert coupler[:3] == ["gimpmd-coupler", "--run-dir", str(folder)]
    assert coupler[-3:] == ["--listen", socket, "--supervised"]
    for name, start in (
        ("md", ["mpiexec", "-n", "4", "gimpmd-md", "serve", "--run-dir", str(folder)]),
        ("gimp", ["mpiexec", "-n", "3", "gimpmd-gimp", "--run-dir", str(folder)]),
    ):
        found = sides(described)[name]
        assert found[: len(start)] == start
        assert found[-2:] == ["--connect", socket]


def test_only_the_sides_of_the_case_are_started(tmp_path: Path) -> None:
    described = describe(OURS, case({"only": "md"}), tmp_path, tmp_path / "run")
    assert list(sides(described)) == ["md"]


def test_the_program_of_a_continuum_belongs_into_the_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"continuum\.command") as error:
        describe(OURS, case({"continuum.command": ["solid"]}), tmp_path, tmp_path / "run")
    assert f"name the program in {OURS}" in str(error.value)


def test_variables_environment_and_folders(small: Any) -> None:
    described = small({})
    assert words(described.run.coupler) == ["couple", "--run-dir", "/r", "--supervised"]
    assert sides(described)["md"] == ["A=none", "B=$5", "mpiexec", "-n", "1", "md"]


def test_a_run_goes_on_after_a_death_with_the_services_of_the_file(
    small: Any, tmp_path: Path
) -> None:
    described = small({})
    (tmp_path / "run").mkdir()
    again = described.run.again()
    assert again.coupler == described.run.coupler
    assert again.sides("anywhere") == described.run.sides("anywhere")
    assert (tmp_path / "run/bus").is_dir()  # a dead coupler may have removed it


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("services.md.ports", ["80:80"], "services.md.ports = ['80:80']: cannot be honoured here"),
        ("networks", {}, "networks: cannot be honoured without containers"),
        ("services.md.depends_on", ["gimp"], "services.md.depends_on.gimp = 'service_started'"),
        ("services.md.depends_on", ["nobody"], "there is no such service"),
        ("services.coupler.depends_on", ["md"], "the coupler may wait for services with"),
        ("services.extra", {"entrypoint": "x"}, "services.extra: nobody waits for it"),
        ("services.coupler.entrypoint", "", "name the program"),
        ("services.coupler.volumes", ["data:/inside"], "'data:/inside': is no folder"),
        ("services.md.command", "${NOT_THERE:?the thing}", "is not set: the thing"),
    ],
)
def test_what_cannot_be_done_is_refused_by_key(
    small: Any, tmp_path: Path, key: str, value: Any, message: str
) -> None:
    with pytest.raises(InputError) as error:
        small({key: value})
    assert message in str(error.value)
    assert str(tmp_path / "compose.yaml") in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [(None, "cannot be read"), ("a: [", "is not YAML"), ("[]", "services: is missing")],
)
def test_a_file_that_describes_nothing(tmp_path: Path, text: str | None, message: str) -> None:
    file = tmp_path / "compose.yaml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=message):
        describe(file, case(), tmp_path, tmp_path / "run")


def test_a_missing_service_is_named(tmp_path: Path) -> None:
    file = tmp_path / "compose.yaml"
    file.write_text("services: {coupler: {entrypoint: couple}}")
    with pytest.raises(InputError, match=r"services\.md: is missing"):
        describe(file, case(), tmp_path, tmp_path / "run")
