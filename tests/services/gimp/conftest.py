"""Small bodies for the GIMP tests: density 1, longitudinal wave speed 1."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from gimpmd_schemas.case.form import Case
from tests.cases import BAR


def make_case(**changes: Any) -> Case:
    """A periodic bar, 32 cells long and 2 high, run by the continuum alone."""
    return msgspec.convert(BAR | changes, Case, strict=True)


@pytest.fixture
def build():
    """Function that makes a case, keys replaced by its arguments."""
    return make_case
