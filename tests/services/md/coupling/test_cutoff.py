"""Whether a potential's range fits the zones and the scheme."""

from __future__ import annotations

import pytest

from gimpmd_md.coupling.cutoff import check_cutoff
from gimpmd_schemas.errors import BackendError


def test_ranges_that_fit() -> None:
    check_cutoff("a.in", 2.5, True, "velocity", 2.5)
    check_cutoff("a.in", 2.5, False, "velocity", 5.0)
    check_cutoff("a.in", 2.5, True, "paper", 3.0)
    check_cutoff("a.in", 2.5, True, "force", 0.0)  # its planes are checked with the crystal


def test_boundary_atoms_must_hide_the_surface() -> None:
    with pytest.raises(BackendError, match=r"a.in: the pair cutoff 3 is wider than the outer zone"):
        check_cutoff("a.in", 3.0, True, "velocity", 2.6)
    with pytest.raises(BackendError, match=r"two cutoffs.* 5 is wider .* to at least 5"):
        check_cutoff("a.in", 2.5, False, "velocity", 2.6)


def test_the_force_scheme_needs_pairs() -> None:
    with pytest.raises(BackendError, match=r"coupling.scheme: force needs one; use .* velocity"):
        check_cutoff("a.in", 2.5, False, "force", 5.0)
