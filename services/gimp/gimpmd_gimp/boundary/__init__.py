"""Conditions on the body."""
