"""Compiled functions whose code on disk is made anew when a source of it has changed.

numba keeps the machine code of a function on disk until the file of this function changes. But the
code contains other functions too, and these may lie in other files. With the code of an earlier
version of these files, an installation would have other results than another with the same sources.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba

SHARED = "gimpmd_schemas"
"""Package whose functions all others may contain."""

COMPILED = re.compile(rb"numba|njit|^@(kernel|sweep|piece)$", re.MULTILINE)
"""What files with compiled functions have in them."""


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function as ``numba.njit`` does.

    With ``cache=True``, code on disk counts as long as no file with compiled functions has changed
    in the packages of gimpmd from which the module of the function imports. Constants that a
    function takes from other files are not looked at.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        made = numba.njit(**options)(function)
        if options.get("cache"):
            file = made._cache._cache_file  # numba has no public way to add to the stamp
            file._source_stamp = file._source_stamp, sources_of(function)
        return made

    return compiled


def sources_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Digests of the compiled sources of all packages that a function may use."""
    used = [function, *function.__globals__.values()]
    modules = (getattr(one, "__module__", None) or "" for one in used)
    packages = {name.partition(".")[0] for name in modules if name.startswith("gimpmd")}
    return tuple(_digest(Path(sys.modules[p].__path__[0])) for p in sorted(packages | {SHARED}))


@cache
def _digest(folder: Path) -> str:
    """Digest of all files with compiled functions in a folder."""
    found = sha256()
    for path in sorted(folder.rglob("*.py")):
        source = path.read_bytes()
        if COMPILED.search(source):
            found.update(source)
    return found.hexdigest()
