"""Results of the check of a service, one JSON object per line."""

from __future__ import annotations

from typing import Literal, get_args

import msgspec

Group = Literal[
    "registration",
    "course",
    "disturbances",
    "checkpoint",
    "silence",
    "wrong fields",
    "lost coupler",
    "translation",
    "uniform strain",
    "rotation",
]
"""Groups of checks, in their order. Each starts the service anew."""
GROUPS: tuple[Group, ...] = get_args(Group)


class Checked(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one check.

    Attributes
    ----------
    group : the group to which it belongs.
    what : what the service does if it passes.
    passed : whether it does; null if the check was not made.
    expected : what was expected; empty if the check has not failed.
    came : what came instead; of a check that has passed what it has measured, if anything; of one
        that was not made the reason.
    """

    group: Group
    what: str
    passed: bool | None
    expected: str = ""
    came: str = ""
