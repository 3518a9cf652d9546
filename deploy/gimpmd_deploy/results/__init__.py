"""Results: what a run wrote, read as numpy arrays, summarised and compared."""
