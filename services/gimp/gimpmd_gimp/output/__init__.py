"""Files that the continuum writes: fields and checkpoints."""
