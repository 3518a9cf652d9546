"""Verification: which waves the set-up of a case can represent."""
