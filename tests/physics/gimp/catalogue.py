"""The gates of all families, in the order of docs/verification.md."""

from gimp import levels, manufactured, waves  # noqa: F401
from gimp.gates import GATES

__all__ = ["GATES"]
