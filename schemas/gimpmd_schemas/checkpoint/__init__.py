"""Checkpoints on disk: the manifest that makes one whole, and the state of each rank."""
