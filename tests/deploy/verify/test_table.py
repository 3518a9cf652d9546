"""The verdict of a verification as a table."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from gimpmd_deploy.verify.strips import Wave
from gimpmd_deploy.verify.table import print_verdict
from gimpmd_deploy.verify.tasks import Task
from gimpmd_deploy.verify.verdict import judge
from tests.deploy.verify.crystal import HEXAGONAL, ground


@pytest.mark.parametrize(
    ("transmitted", "words"),
    [
        (1.0, "shortest wavelength that crosses faithfully: 8 h"),
        (0.7, "no wavelength that was run"),
    ],
)
def test_rows_and_result(transmitted: float, words: str) -> None:
    wave = Wave(8.0, "P")
    shares = {
        Task(wave, "into"): (0.02, transmitted),
        Task(wave, "into", "continuum"): (0.02, 0.98),
    }
    text = io.StringIO()
    print_verdict(judge(ground(HEXAGONAL), shares), Console(file=text, width=140))
    assert f"{transmitted:.4f}" in text.getvalue()
    assert words in text.getvalue()
