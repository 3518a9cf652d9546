"""Gates of the coupling: what an interface must show, for each scheme.

`python -m tests.physics.interface` runs all of them; `make verify-interface`
does. Every gate runs whole coupled strips by the command, in separate processes. Bounds are the
acceptance of the study behind docs/theory.md.
"""
