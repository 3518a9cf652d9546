"""Gates of the continuum solver: what it must show before anyone trusts it.

`python -m tests.physics.gimp` runs all of them; `make verify-gimp` does.
Every gate compares with an exact solution, with theory, or with figures of an independent
prototype in one dimension (docs/verification.md).
"""
