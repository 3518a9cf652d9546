"""The command ``gimpmd``, put together from its commands."""

from __future__ import annotations

import signal
from types import FrameType
from typing import NoReturn

import typer

from gimpmd_deploy.cli.backends import backends
from gimpmd_deploy.cli.check import check_service
from gimpmd_deploy.cli.compare import compare
from gimpmd_deploy.cli.doctor import doctor
from gimpmd_deploy.cli.errors import report_errors
from gimpmd_deploy.cli.film import film
from gimpmd_deploy.cli.keys import new
from gimpmd_deploy.cli.lattice import lattice
from gimpmd_deploy.cli.plot import plot
from gimpmd_deploy.cli.prepare import prepare
from gimpmd_deploy.cli.replay import replay
from gimpmd_deploy.cli.report import report
from gimpmd_deploy.cli.run import resume, run, up
from gimpmd_deploy.cli.slurm import slurm
from gimpmd_deploy.cli.strain import strain_dump
from gimpmd_deploy.cli.streams import outlive_readers
from gimpmd_deploy.cli.validate import validate
from gimpmd_deploy.cli.verify import verify_interface
from gimpmd_schemas.errors import STOPPED

app = typer.Typer(
    name="gimpmd",
    help="Molecular dynamics (LAMMPS) coupled with the material point method (GIMP).",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (
    run,
    up,
    resume,
    prepare,
    slurm,
    doctor,
    backends,
    replay,
    validate,
    lattice,
    plot,
    film,
    report,
    compare,
):
    app.command()(report_errors(command))


def group(name: str, help_text: str) -> typer.Typer:
    """Add a command that has commands of its own."""
    inner = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    inner.callback()(lambda: None)  # keeps the name of an only command
    app.add_typer(inner, name=name, help=help_text)
    return inner


keys_app = group("keys", "Keys of runs across hosts.")
keys_app.command("new")(report_errors(new))
check_app = group("check", "Check what takes part in a run.")
check_app.command("service")(report_errors(check_service))
strain_app = group("strain", "Strain of the atoms of any LAMMPS run.")
strain_app.command("dump")(report_errors(strain_dump))
verify_app = group("verify", "Measure what the set-up of a case can represent.")
verify_app.command("interface")(report_errors(verify_interface))


_INTERRUPTED = 130
"""Exit code of Typer for Ctrl-C before a command begins."""


def main() -> None:
    """Entry point of ``gimpmd``."""
    outlive_readers()
    signal.signal(signal.SIGTERM, _interrupt)  # temporary folders are removed
    try:
        app()
    except SystemExit as end:
        if end.code == _INTERRUPTED:
            raise SystemExit(STOPPED) from None
        raise


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
