"""The gates of all families, in the order of docs/verification.md."""

from tests.physics.gimp import manufactured, waves, levels, motion, ranks  # noqa: F401, I001
from tests.physics.gimp.gates import GATES

__all__ = ["GATES"]
