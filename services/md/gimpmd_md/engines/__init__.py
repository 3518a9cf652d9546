"""Molecular dynamics codes that can hold the atoms."""
