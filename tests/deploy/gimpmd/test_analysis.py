"""The room for users holds what its page describes."""

from __future__ import annotations

import inspect
from pathlib import Path

from gimpmd import analysis

PAGE = (Path(__file__).parents[3] / "docs" / "analysis.md").read_text("utf-8")


def test_every_function_is_described() -> None:
    names = [n for n in analysis.__all__ if inspect.isfunction(getattr(analysis, n))]
    assert len(names) > 10
    for name in names:
        assert f"`{name}" in PAGE, name


def test_every_class_is_the_result_or_the_input_of_a_function() -> None:
    functions = [getattr(analysis, name) for name in analysis.__all__]
    signatures = " ".join(
        str(inspect.signature(one)) for one in functions if inspect.isfunction(one)
    )
    for name in analysis.__all__:
        if inspect.isclass(getattr(analysis, name)):
            assert name in signatures, name
