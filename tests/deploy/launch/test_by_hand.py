"""Runs whose services are started by hand."""

import msgspec
import pytest

from gimpmd_deploy.launch.by_hand import commands, host_of, meeting_place
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import InputError
from tests.cases import CASE, changed


@pytest.mark.parametrize(
    ("text", "host"), [("node7:7447", "node7"), ("10.0.0.7:80", "10.0.0.7"), ("[::1]:80", "::1")]
)
def test_host(text, host):
    assert host_of(text) == host


@pytest.mark.parametrize("text", ["node7", "node7:", ":7447", "node7:0", "node7:70000", "node7:x"])
def test_bad_places(text):
    with pytest.raises(InputError, match="is not HOST:PORT"):
        host_of(text)


def test_meeting_on_one_host(tmp_path):
    endpoint = meeting_place(tmp_path, None)
    assert endpoint == f"unixsock-stream/{tmp_path}/bus/socket"
    assert (tmp_path / "bus").stat().st_mode & 0o777 == 0o700


def test_commands_name_the_same_run_and_place(tmp_path):
    plan = make_plan(msgspec.convert(CASE, Case))
    found = commands(plan, tmp_path, "block-1", "tls/node7:7447")
    assert [words[0] for words in found.values()] == ["gimpmd-coupler", "gimpmd-md", "gimpmd-gimp"]
    for words in found.values():
        assert words[words.index("--run-dir") + 1] == str(tmp_path)
        assert words[words.index("--run") + 1] == "block-1"
        assert "tls/node7:7447" in words


def test_the_command_of_a_continuum_in_another_language(tmp_path):
    case = msgspec.convert(changed(CASE, {"continuum.command": ["/opt/solid", "--fast"]}), Case)
    words = commands(make_plan(case), tmp_path, "block-1", "tls/node7:7447")["gimp"]
    assert words[:3] == ["/opt/solid", "--fast", "--run-dir"]
