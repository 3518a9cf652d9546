"""Compiled sweeps over material points and nodes."""
