"""The coupler, and ``participant``: the library with which a service takes part in a run."""
