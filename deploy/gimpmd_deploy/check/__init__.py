"""The check of a service by the command: its cases, and the process that makes the checks."""
