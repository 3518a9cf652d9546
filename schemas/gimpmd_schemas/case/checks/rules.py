"""What the checks of a case share: a list of problems that reads as a list of rules."""

from __future__ import annotations

from gimpmd_schemas.errors import Problem

AXES = "xyz"
"""Names of the axes in messages."""


class Rules:
    """Collects problems; ``require`` reads as a rule."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def require(self, holds: bool, key: str, value: object, message: str, hint: str = "") -> bool:
        """Note a problem unless the rule holds; says whether it does."""
        if not holds:
            self.problems.append(Problem(key, value, message, hint))
        return holds
