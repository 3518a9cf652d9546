"""The services of a run as a compose file describes them, as commands without containers.

The file describes what the services are and what they wait for; `deploy/compose.yaml` is such a
file. Keys that only describe a container are left alone, and keys that would have another effect in
containers than here are refused.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from gimpmd_deploy.launch.by_hand import meeting_place
from gimpmd_deploy.launch.processes import Service, end_all, start
from gimpmd_deploy.launch.run import ReadyRun
from gimpmd_deploy.launch.services import COUPLER_CODES, NAMES, RunServices
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError, InputError, PeerLostError, Problem

COUPLER = "coupler"
CONTAINER_KEYS = {"image", "build", "network_mode", "healthcheck"}
"""Keys that say nothing about the command.

``healthcheck`` is among them because the coupler itself says when it listens.
"""
KEYS = CONTAINER_KEYS | {"entrypoint", "command", "environment", "volumes", "depends_on"}

SECONDS = 600.0
"""How long a service may take that must end before the coupler starts."""

_VARIABLE = re.compile(r"\$(?:(\$)|(\w+)|\{(\w+)(?::?([-?])([^}]*))?\})")


@dataclass(frozen=True)
class Described:
    """What a compose file describes.

    Attributes
    ----------
    first : services that must end before the coupler starts.
    run : the coupler and the sides.
    """

    first: tuple[Service, ...]
    run: RunServices


def describe(file: Path, case: Case, source: Path, folder: Path) -> Described:
    """Read the services of a run from a compose file.

    Parameters
    ----------
    file : Path
        In the format of https://compose-spec.io, with services ``coupler``, ``md`` and ``gimp``.
    case : Case
        For the ranks, and the sides that take part.
    source, folder : Path
        Folders of the case and of the run.

    Raises
    ------
    InputError
        The file cannot be read, or contains what cannot be done without containers.
    """
    variables = os.environ | {
        "CASE": str(source.absolute()),
        "RUN": str(folder.absolute()),
        "RANKS_GIMP": str(case.continuum.ranks),
        **({"RANKS_MD": str(case.md.ranks)} if case.md is not None else {}),
    }
    problems: list[Problem] = []
    content = _filled(_read(file), variables, "", problems)
    services = content.get("services") if isinstance(content, dict) else None
    if not isinstance(services, dict):
        raise InputError(str(file), [Problem("services", None, "is missing")])
    problems += [
        Problem(key, None, "cannot be honoured without containers", "leave it out")
        for key in content
        if key not in ("name", "services") and not key.startswith("x-")
    ]
    if case.continuum.command:
        hint = f"leave it out, and name the program in {file}"
        words = list(case.continuum.command)
        problems.append(Problem("continuum.command", words, "is not used with a file", hint))
    sides = [NAMES[role] for role in case.roles()]
    first = _check_services(services, sides, problems)
    commands = {
        name: _command(name, services[name], problems)
        for name in (*first, COUPLER, *sides)
        if name in services
    }
    if problems:
        raise InputError(str(file), problems)

    def service(name: str, *more: str) -> Service:
        words = [*commands[name], *more]
        return Service(name, words, folder / "logs" / f"{name}.log", folder)

    coupler = replace(service(COUPLER, "--supervised"), good_codes=COUPLER_CODES)
    run = RunServices(
        coupler, lambda _: [service(name) for name in sides], again=lambda: _meeting(folder, run)
    )
    return Described(tuple(service(name) for name in first), run)


def start_first(ready: ReadyRun, described: Described) -> ReadyRun:
    """Run what must end before the coupler starts; return the run with the described services.

    Raises
    ------
    BackendError, PeerLostError
        A service failed, or did not end.
    """
    run = _meeting(ready.folder, described.run)
    for service in described.first:
        child = start(service)
        try:
            child.process.wait(SECONDS)
        except subprocess.TimeoutExpired:
            raise PeerLostError(f"{service.name} did not end within {SECONDS:g} s") from None
        finally:
            end_all([child], terminate=1.5, kill=1.0)
        if child.failed():
            raise BackendError(f"{service.name} {child.how()}")
    return replace(ready, services=run)


def _meeting(folder: Path, run: RunServices) -> RunServices:
    """The services, once the folder is there in which they meet."""
    meeting_place(folder, None)
    return run


def _read(file: Path) -> Any:
    try:
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        problem = Problem("--file", None, f"cannot be read: {error.strerror}")
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        problem = Problem("--file", None, f"is not YAML: {error}")
    raise InputError(str(file), [problem])


def _filled(value: Any, variables: Mapping[str, str], where: str, problems: list[Problem]) -> Any:
    """Fill in variables everywhere, as compose does."""
    if isinstance(value, dict):
        return {
            key: _filled(part, variables, f"{where}.{key}".lstrip("."), problems)
            for key, part in value.items()
        }
    if isinstance(value, list):
        return [_filled(part, variables, where, problems) for part in value]
    if not isinstance(value, str):
        return value

    def fill(found: re.Match[str]) -> str:
        dollar, short, long, kind, text = found.groups()
        name = short or long
        if dollar or variables.get(name):
            return dollar or variables[name]
        if kind == "?":
            problems.append(Problem(where, f"${{{name}}}", f"is not set: {text}", f"export {name}"))
        return text if kind == "-" else ""

    return _VARIABLE.sub(fill, value)


def _check_services(
    services: Mapping[str, Any], sides: list[str], problems: list[Problem]
) -> list[str]:
    """Check keys and dependencies; return the services that must end before the coupler starts."""
    for name in (COUPLER, *sides):
        if name not in services:
            problems.append(Problem(f"services.{name}", None, "is missing"))
    for name, service in services.items():
        for key in sorted(set(service) - KEYS):
            hint = f"leave it out, or use containers; understood are {', '.join(sorted(KEYS))}"
            where = f"services.{name}.{key}"
            problems.append(Problem(where, service[key], "cannot be honoured here", hint))
    first = []
    for name in services:
        for other, condition in _waits_for(services[name]).items():
            where = f"services.{name}.depends_on.{other}"
            if other not in services:
                problems.append(Problem(where, None, "there is no such service"))
            elif name == COUPLER and condition == "service_completed_successfully":
                first.append(other)
            elif name not in NAMES.values() or other != COUPLER or "completed" in condition:
                hint = (
                    "the coupler may wait for services with service_completed_successfully, and"
                    " md and gimp for the coupler with service_started or service_healthy"
                )
                problems.append(Problem(where, condition, "cannot be honoured here", hint))
    for name in services:
        if name not in (COUPLER, *NAMES.values(), *first):
            hint = "add it to depends_on of the coupler with service_completed_successfully"
            problems.append(Problem(f"services.{name}", None, "nobody waits for it", hint))
    return first


def _waits_for(service: Mapping[str, Any]) -> dict[str, str]:
    """Conditions by the names of the services for which one waits."""
    given = service.get("depends_on", {})
    if isinstance(given, list):
        return dict.fromkeys(given, "service_started")
    return {name: options.get("condition", "service_started") for name, options in given.items()}


def _command(name: str, service: Mapping[str, Any], problems: list[Problem]) -> list[str]:
    """Words of a service, with the places of the host in place of those in the container."""
    words = [word for key in ("entrypoint", "command") for word in _words(service.get(key, []))]
    if not service.get("entrypoint"):
        hint = "name the program; without containers, nothing else says which one it is"
        problems.append(Problem(f"services.{name}.entrypoint", None, "is missing", hint))
    for volume in service.get("volumes", []):
        place, _, rest = str(volume).partition(":")
        inside = rest.partition(":")[0]
        if not place.startswith("/") or not inside.startswith("/"):
            hint = "write PLACE:PLACE_IN_CONTAINER, both from the root /"
            problems.append(Problem(f"services.{name}.volumes", volume, "is no folder", hint))
            continue
        words = [_moved(word, inside, place) for word in words]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    given = service.get("environment", {})
    pairs = given if isinstance(given, list) else [f"{key}={text}" for key, text in given.items()]
    return ["env", f"PATH={path}", *map(str, pairs), *words]


def _words(given: Any) -> list[str]:
    return shlex.split(given) if isinstance(given, str) else [str(word) for word in given]


def _moved(word: str, inside: str, place: str) -> str:
    """Replace a folder; a word with spaces is a script for a shell."""
    new = shlex.quote(place) if re.search(r"\s", word) else place
    return re.sub(rf"(?<![\w.-]){re.escape(inside)}(?=$|[/\s])", lambda _: new, word)
