"""Errors of a command as one message and an exit code."""

import re
from pathlib import Path

import pytest
import typer

from gimpmd_deploy.cli.errors import report_errors
from gimpmd_schemas.errors import BackendError, PeerLostError


@pytest.mark.parametrize(("kind", "code"), [(BackendError, 2), (PeerLostError, 3)])
def test_our_own_errors_have_their_exit_code(capsys, kind, code):
    @report_errors
    def command() -> None:
        raise kind("what went wrong")

    with pytest.raises(typer.Exit) as caught:
        command()
    assert caught.value.exit_code == code
    assert capsys.readouterr().err == "error: what went wrong\n"


def test_the_traceback_of_an_internal_error_goes_to_a_file(capsys):
    @report_errors
    def command() -> None:
        raise ZeroDivisionError

    with pytest.raises(typer.Exit) as caught:
        command()
    assert caught.value.exit_code == 3
    said = capsys.readouterr().err
    assert "Traceback" not in said
    log = Path(re.search(r"the traceback is in (\S+)", said)[1])
    assert "ZeroDivisionError" in log.read_text()
    log.unlink()
