"""From a case to a running set of processes."""
