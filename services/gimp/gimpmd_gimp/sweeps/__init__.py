"""Compiled loops over material points, and the threads that share them."""
