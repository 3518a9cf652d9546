"""A list of problems, collected by checks that read as rules."""

from __future__ import annotations

from gimpmd_schemas.errors import Problem

AXES = "xyz"
"""Names of the axes in messages."""


class Rules:
    """Collects problems; ``require`` reads as a rule."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def require(self, holds: bool, key: str, value: object, message: str, hint: str = "") -> bool:
        """Add a problem unless the rule holds; returns whether it holds."""
        if not holds:
            self.problems.append(Problem(key, value, message, hint))
        return holds
