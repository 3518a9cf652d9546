"""Notes the results of checks as they are made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gimpmd_schemas.wire.conformance import Checked, Group


class UnmetError(Exception):
    """The service does not do what was expected.

    Attributes
    ----------
    expected, came : in words, for people to read.
    """

    def __init__(self, expected: str, came: str) -> None:
        super().__init__(f"expected {expected}, came {came}")
        self.expected, self.came = expected, came


class RefusalError(UnmetError):
    """The service refuses the plan, because it does not have what the body of the check needs.

    Attributes
    ----------
    reason : what it says.
    """

    def __init__(self, reason: str) -> None:
        super().__init__("a service that takes the plan", f"the request Failed: {reason}")
        self.reason = reason


class GroupEndedError(Exception):
    """A check of a group has failed, so the others cannot be made; the result has been noted."""


def expect(met: bool, expected: str, came: str) -> None:
    """Go on only if an expectation is met.

    Raises
    ------
    UnmetError
        It is not.
    """
    if not met:
        raise UnmetError(expected, came)


class Log:
    """The results of one group of checks.

    Parameters
    ----------
    group : name of the group.
    tell : takes each result at once.
    may_refuse : whether a refusal of the plan is no failure.

    Attributes
    ----------
    passed : how many checks have passed.
    """

    def __init__(
        self, group: Group, tell: Callable[[Checked], None], may_refuse: bool = False
    ) -> None:
        self._group, self._tell, self._may_refuse = group, tell, may_refuse
        self._measured = ""
        self.passed = 0

    @contextmanager
    def checking(self, what: str) -> Iterator[None]:
        """Note the result of the check in the block: it has passed unless `UnmetError` is raised.

        Raises
        ------
        GroupEndedError
            The check has failed.
        RefusalError
            The service refuses the plan, and may do so.
        """
        self._measured = ""
        with self._noting(what):
            yield
        self._note(what, True, came=self._measured)
        self.passed += 1

    @contextmanager
    def on_the_way(self) -> Iterator[None]:
        """Note a failure on the way to a check.

        Raises
        ------
        GroupEndedError
            There was one, or a check has failed.
        RefusalError
            The service refuses the plan, and may do so.
        """
        with self._noting("comes to its checks"):
            yield

    @contextmanager
    def _noting(self, what: str) -> Iterator[None]:
        try:
            yield
        except UnmetError as unmet:
            if self._may_refuse and isinstance(unmet, RefusalError):
                raise
            self._note(what, False, unmet.expected, unmet.came)
            raise GroupEndedError from None

    def measure(self, text: str) -> None:
        """Give what the present check has measured, for the report if it passes."""
        self._measured = text

    def leave_out(self, what: str, why: str) -> None:
        """Note that a check was not made."""
        self._note(what, None, came=why)

    def _note(self, what: str, passed: bool | None, expected: str = "", came: str = "") -> None:
        self._tell(
            Checked(group=self._group, what=what, passed=passed, expected=expected, came=came)
        )
