"""Conditions on the body, one module for each."""
