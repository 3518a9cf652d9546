"""``gimpmd check service``: whether a service keeps the protocol and the laws of mechanics."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, get_args

import msgspec
import typer
from rich.console import Console

from gimpmd_deploy.check.cases import BODIES, Checkup
from gimpmd_deploy.check.service import check_service as results_of
from gimpmd_deploy.cli.options import Json, Side, standard_output
from gimpmd_schemas.errors import GimpmdError, InputError, Problem
from gimpmd_schemas.wire.conformance import GROUPS, Checked, Group

WORDS = {True: "passed", False: "FAILED", None: "not made"}


def check_service(
    side: Annotated[Side, typer.Option("--side", help="The side that the service runs.")],
    command: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- COMMAND]",
            help="Command of the service; default: the service of gimpmd for this side.",
            show_default=False,
        ),
    ] = None,
    backend: Annotated[
        str | None,
        typer.Option("--backend", help="Code of this side, as in gimpmd backends.", metavar="NAME"),
    ] = None,
    body: Annotated[
        str,
        typer.Option("--body", help=f"Built-in cases: {', '.join(BODIES)}.", metavar="NAME"),
    ] = "strip",
    ranks: Annotated[
        int, typer.Option("--ranks", min=1, help="Ranks of the service, started by mpiexec.")
    ] = 1,
    peers: Annotated[
        int, typer.Option("--peers", min=1, help="Ranks of the other side, which are played.")
    ] = 1,
    case: Annotated[
        Path | None,
        typer.Option("--case", help="Coupled case in place of the built-in one.", metavar="CASE"),
    ] = None,
    free_case: Annotated[
        Path | None,
        typer.Option("--free-case", help="Case of a free body, to be rotated.", metavar="CASE"),
    ] = None,
    groups: Annotated[
        str | None,
        typer.Option("--groups", help=f"Only these: {', '.join(GROUPS)}.", metavar="LIST"),
    ] = None,
    deadline: Annotated[
        float, typer.Option("--deadline", min=0.1, help="Seconds for each answer of the service.")
    ] = 10.0,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Keep run folders and logs here.", metavar="DIR"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Play the coupler and the other side against a service, and report what it does."""
    chosen = _groups(groups)
    _check_body(body)
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(str(out), [Problem("--out", None, "is not empty", "choose another")])
    console, results = standard_output(), []
    with ExitStack() as resources:
        temporary = tempfile.TemporaryDirectory(prefix="gimpmd-check-")
        folder = out or Path(resources.enter_context(temporary))
        for result in results_of(
            Checkup(side.value, backend, ranks, peers), command or [], folder,
            body=body, case=case, free_case=free_case, groups=chosen, deadline=deadline,
        ):  # fmt: skip
            results.append(result)
            if as_json:
                typer.echo(msgspec.json.encode(result).decode())
            else:
                _print(result, console)
    _conclude(results, out)


def _check_body(name: str) -> None:
    """Check the name of a body.

    Raises
    ------
    InputError
        There is no such body.
    """
    if name not in BODIES:
        hint = f"choose among {', '.join(BODIES)}"
        raise InputError("gimpmd", [Problem("--body", name, "is no body of the checks", hint)])


def _groups(text: str | None) -> Sequence[Group]:
    """Groups from the option.

    Raises
    ------
    InputError
        There is no such group.
    """
    if text is None:
        return GROUPS
    words = [word.strip() for word in text.split(",")]
    unknown = [word for word in words if word not in get_args(Group)]
    if unknown:
        hint = f"choose among {', '.join(GROUPS)}"
        problems = [Problem("--groups", word, "is no group of checks", hint) for word in unknown]
        raise InputError("gimpmd", problems)
    return [group for group in GROUPS if group in words]


def _print(result: Checked, console: Console) -> None:
    measured = f" ({result.came})" if result.came and result.passed is not False else ""
    line = f"{WORDS[result.passed]:8}  {result.group}: {result.what}{measured}"
    console.print(line, style="red" if result.passed is False else "", markup=False)
    if result.passed is False:
        for name, text in (("expected", result.expected), ("came", result.came)):
            console.print(f"          {name} {text}", markup=False, soft_wrap=True)


def _conclude(results: Sequence[Checked], out: Path | None) -> None:
    """Say how many checks have failed.

    Raises
    ------
    GimpmdError
        At least one has.
    """
    failed = [result for result in results if result.passed is False]
    if failed:
        where = f"; logs are in {out}" if out else "; --out DIR keeps its logs"
        raise GimpmdError(
            f"the service failed {len(failed)} of {len(results)} checks; a group ends with its"
            f" first failure{where}"
        )
