"""Arguments with which services are started."""

from __future__ import annotations

import argparse
from pathlib import Path

from gimpmd_coupler.bus.settings import CONNECT_SECONDS
from gimpmd_schemas.wire.access import KEYS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare them: ``run_dir``, ``run``, ``connect``, ``keys`` and ``patience``."""
    parser.add_argument("--run-dir", type=Path, required=True, help="folder of the run")
    parser.add_argument("--run", required=True, help="id of the run")
    parser.add_argument("--connect", required=True, help="endpoint of the coupler")
    add_keys(parser)
    parser.add_argument(
        "--patience",
        type=float,
        default=CONNECT_SECONDS,
        metavar="SECONDS",
        help="without a coupler for so long it gives up (default: %(default)g)",
    )


def add_keys(parser: argparse.ArgumentParser) -> None:
    """Declare ``keys``, for `keys_of`."""
    parser.add_argument("--keys", type=Path, help="keys for TLS (default: keys in the run folder)")


def keys_of(options: argparse.Namespace) -> Path:
    """Folder of the keys, whether or not they are needed."""
    return Path(options.keys or options.run_dir / KEYS).resolve()
