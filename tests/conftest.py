"""Processes that tests start find this package too."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = str(Path(__file__).parents[1])
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [ROOT, os.environ.get("PYTHONPATH")]))
