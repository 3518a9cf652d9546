"""Runs the checks of a service, and prints each result as one JSON object."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import NoReturn

import msgspec

from gimpmd_coupler.check import conversation, physics
from gimpmd_coupler.check.bench import Bench
from gimpmd_coupler.check.log import GroupEndedError, Log, RefusalError
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.access import ROLES
from gimpmd_schemas.wire.conformance import GROUPS, Checked, Group


def _course(bench: Bench, log: Log) -> None:
    """An ordinary run, and the balances of its pulse."""
    physics.balances(conversation.course(bench, log), log)


CHECKS: dict[Group, Callable[[Bench, Log], None]] = {
    "registration": conversation.registration,
    "course": _course,
    "disturbances": conversation.disturbances,
    "checkpoint": conversation.checkpoint,
    "silence": conversation.silence,
    "wrong fields": conversation.wrong_fields,
    "lost coupler": conversation.lost_coupler,
    "translation": physics.translation,
    "uniform strain": physics.uniform_strain,
    "rotation": physics.rotation,
}


def examine(bench: Bench, groups: list[Group], tell: Callable[[Checked], None]) -> None:
    """Make the checks of some groups, in their order.

    Parameters
    ----------
    tell : callable
        Takes each result at once.
    """
    hindered = ""
    for group in groups:
        log = Log(group, tell, bench.may_refuse)
        if hindered:
            log.leave_out("all checks", hindered)
            continue
        try:
            with log.on_the_way():
                CHECKS[group](bench, log)
        except GroupEndedError:  # the result has been told
            if group == "registration" and not log.passed:
                hindered = "the service does not register"
        except RefusalError as refusal:
            hindered = f"the service refuses the plan: {refusal.reason}"
            log.leave_out("all checks", hindered)


def main() -> int:
    """Make the checks; returns the exit code: 0 also if checks have failed."""
    parser = argparse.ArgumentParser(prog="python -m gimpmd_coupler.check", description=__doc__)
    parser.add_argument("--side", choices=ROLES, required=True)
    parser.add_argument("--strip", type=Path, required=True, help="folder with a coupled plan")
    parser.add_argument("--block", type=Path, help="folder with a plan of this side alone")
    parser.add_argument("--may-refuse", action="store_true", help="a refusal is no failure")
    parser.add_argument("--out", type=Path, required=True, help="folder for run folders")
    parser.add_argument("--deadline", type=float, default=10.0, help="seconds for each thing")
    parser.add_argument("--groups", default=",".join(GROUPS), help="separated by commas")
    parser.add_argument("words", nargs="+", metavar="COMMAND", help="of the service")
    options = parser.parse_args()
    bench = Bench(
        role=options.side,
        words=options.words,
        strip=options.strip.resolve(),
        block=options.block and options.block.resolve(),
        out=options.out.resolve(),
        deadline=options.deadline,
        may_refuse=options.may_refuse,
    )
    signal.signal(signal.SIGTERM, _end)
    try:
        examine(bench, options.groups.split(","), _print)
    except GimpmdError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit("ended by SIGTERM")  # the service is ended on the way


def _print(result: Checked) -> None:
    print(msgspec.json.encode(result).decode(), flush=True)


if __name__ == "__main__":
    sys.exit(main())
