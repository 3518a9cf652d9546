"""Compiled code on disk is made anew when a file that is part of it has changed."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

GIMP = Path(__file__).parents[2] / "services/gimp/gimpmd_gimp"

CONTRACTED = {"kernel", "sweep", "piece"}
"""Decorators of functions in which products may be contracted with sums."""

PIECE = """\
from gimpmd_schemas.compiled import njit


@njit(cache=True)
def piece(x: float) -> float:
    return {value}
"""

WHOLE = """\
from gimpmd_schemas.compiled import njit
from gimpmd_try.piece import piece


@njit(cache=True)
def whole(x: float) -> float:
    return piece(x)


print(whole(2.0), sum(whole.stats.cache_hits.values()))
"""


def run(folder: Path) -> str:
    """What the module prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "gimpmd_try.whole"],
        env=os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    return done.stdout.strip()


def test_a_function_in_another_file(tmp_path: Path) -> None:
    package = tmp_path / "gimpmd_try"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "piece.py").write_text(PIECE.format(value="x + x"))
    (package / "whole.py").write_text(WHOLE)
    assert run(tmp_path) == "4.0 0"
    assert run(tmp_path) == "4.0 1"  # from the disk
    (package / "piece.py").write_text(PIECE.format(value="3.0 * x"))
    assert run(tmp_path) == "6.0 0"


def powers(function: ast.FunctionDef) -> list[int]:
    """Lines with powers in a function that is compiled with contraction."""
    names = {one.id for one in function.decorator_list if isinstance(one, ast.Name)}
    if not names & CONTRACTED:
        return []
    return [
        one.lineno
        for one in ast.walk(function)
        if isinstance(one, ast.BinOp | ast.AugAssign) and isinstance(one.op, ast.Pow)
    ]


def test_no_powers_are_contracted() -> None:
    """numba compiles them once in a process, contracted or not; see ``gimpmd_gimp.laws.law``."""
    found, seen = [], 0
    for path in GIMP.rglob("*.py"):
        for one in ast.walk(ast.parse(path.read_text())):
            if isinstance(one, ast.FunctionDef):
                seen += any(
                    isinstance(d, ast.Name) and d.id in CONTRACTED for d in one.decorator_list
                )
                found += [f"{path.name}:{line}" for line in powers(one)]
    assert seen > 50
    assert found == []
