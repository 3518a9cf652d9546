"""Checks of a case, one topic per module; every problem is collected before a run starts."""
