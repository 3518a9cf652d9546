"""Cracks, contact of their faces, and energy release at their tips."""
