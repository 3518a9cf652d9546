"""Nested levels of the background grid and their nodes."""
