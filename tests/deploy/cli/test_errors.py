"""Errors of a command as one message and an exit code."""

import errno
import os
import re
import tempfile
from pathlib import Path

import pytest
import typer

from gimpmd_deploy.cli.errors import report_errors
from gimpmd_schemas.errors import STOPPED, BackendError, PeerLostError


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


def test_ctrl_c_has_the_exit_code_of_a_stop(capsys):
    @report_errors
    def command() -> None:
        raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as caught:
        command()
    assert caught.value.exit_code == STOPPED == 5
    assert capsys.readouterr().err == "error: interrupted\n"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS])
def test_a_disk_that_takes_no_more_is_one_clear_error(capsys, number):
    @report_errors
    def command() -> None:
        raise OSError(number, os.strerror(number), "figures/energies.png")

    with pytest.raises(typer.Exit) as caught:
        command()
    assert caught.value.exit_code == 3
    expected = f"error: figures/energies.png: cannot be written: {os.strerror(number)}\n"
    assert capsys.readouterr().err == expected


def test_an_internal_error_is_told_even_if_its_traceback_cannot_be_written(capsys, monkeypatch):
    def full_disk(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    @report_errors
    def command() -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", full_disk)
    with pytest.raises(typer.Exit):
        command()
    said = capsys.readouterr().err
    assert "internal error: ZeroDivisionError" in said
    assert "the traceback cannot be written: No space left on device" in said
