"""Commands of the services of a run."""

from pathlib import Path

import msgspec
import pytest

from gimpmd_deploy.launch import services as module
from gimpmd_deploy.launch.services import services_of, with_full_paths
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from tests.cases import CASE, CONTINUUM_ONLY, changed


def services(tmp_path, changes):
    plan = make_plan(msgspec.convert(changed(CASE, changes), Case))
    found = services_of(plan, tmp_path / "run")
    return found.coupler, {one.name: one for one in found.sides("tcp/x")}


def test_services_of_a_coupled_run(tmp_path):
    coupler, sides = services(tmp_path, {})
    assert list(sides) == ["md", "gimp"]
    run = coupler.argv[coupler.argv.index("--run") + 1]
    for service in sides.values():
        words = list(service.argv)
        assert words[words.index("--run") + 1] == run
        assert words[words.index("--connect") + 1] == "tcp/x"
    assert sides["md"].cwd == tmp_path / "run" / "input"
    assert sides["gimp"].log == tmp_path / "run" / "logs" / "gimp.log"


def test_gimp_is_started_on_its_ranks(tmp_path):
    _, sides = services(tmp_path, {"continuum.ranks": 2})
    assert sides["gimp"].argv[1:3] == ["-n", "2"]
    _, sides = services(tmp_path, {})
    assert "-n" not in sides["gimp"].argv
    assert sides["md"].argv[1:3] == ["-n", "1"]  # LAMMPS always runs under MPI


def test_a_run_of_one_side_has_one_service(tmp_path, monkeypatch):
    def missing():
        raise BackendError("no mpiexec")

    monkeypatch.setattr(module, "mpiexec", missing)
    _, sides = services(tmp_path, CONTINUUM_ONLY)
    assert list(sides) == ["gimp"]
    with pytest.raises(BackendError, match="no mpiexec"):
        services(tmp_path, {})
    assert not Path(tmp_path / "run").exists()


def test_a_continuum_in_another_language_gets_the_words_of_its_own_and_those_of_the_run(tmp_path):
    changes = {"continuum.command": ["/opt/solid", "--fast"]}
    _, sides = services(tmp_path, changes)
    assert sides["gimp"].argv[:4] == ["/opt/solid", "--fast", "--run-dir", str(tmp_path / "run")]
    assert sides["md"].argv[3:6] == services(tmp_path, {})[1]["md"].argv[3:6]
    _, sides = services(tmp_path, changes | {"continuum.ranks": 2})
    assert sides["gimp"].argv[1:4] == ["-n", "2", "/opt/solid"]


def test_a_side_may_be_started_in_another_way(tmp_path):
    plan = make_plan(msgspec.convert(changed(CASE, {}), Case))
    found = services_of(plan, tmp_path / "run", {"md": ["mpiexec", "-n", "3", "tool"]})
    md, gimp = found.sides("tcp/x")
    assert md.argv[:5] == ["mpiexec", "-n", "3", "tool", "--run-dir"]
    assert md.argv[-2:] == ["--connect", "tcp/x"]
    assert (md.cwd, md.log.name) == (tmp_path / "run" / "input", "md.log")
    assert gimp.argv[1:3] == ["-m", "gimpmd_gimp.service"]


def test_a_run_goes_on_after_a_death_with_the_same_commands_and_another_run_id(tmp_path):
    plan = make_plan(msgspec.convert(changed(CASE, {}), Case))
    first = services_of(plan, tmp_path / "run", {"md": ["tool"]})
    second = first.again()
    for one, other in zip(first.sides("tcp/x"), second.sides("tcp/x"), strict=True):
        place = list(one.argv).index("--run") + 1
        assert one.argv[place] != other.argv[place]
        assert one.argv[:place] == other.argv[:place]
        assert one.argv[place + 1 :] == other.argv[place + 1 :]


def test_words_that_name_files_become_full_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tool.py").touch()
    assert with_full_paths(["python", "tool.py"]) == ["python", str(tmp_path / "tool.py")]
