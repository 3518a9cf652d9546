"""The command ``gimpmd``."""
