"""Whether the range of the potential fits the zones and the scheme of a coupled run."""

from __future__ import annotations

from gimpmd_schemas.case.form import AT_PLANES, SchemeName
from gimpmd_schemas.errors import BackendError


def check_cutoff(
    script: str, cutoff: float, pairwise: bool, scheme: SchemeName, outer: float
) -> None:
    """Check that boundary atoms hide the surface of the MD region from the free atoms.

    Paper section 4.1. If the force on an atom depends on the surroundings of its neighbours too, as
    in EAM, the surface must be two cutoffs away. The force scheme works with single bonds, so it
    needs a sum over pairs. In the schemes with planes the depth of the planes is checked with the
    crystal.

    Parameters
    ----------
    script : str
        Input of the MD code, for the message.
    cutoff : float
        Range of the potential (length).
    pairwise : bool
        Whether the potential is a sum over pairs.
    scheme : str
        Coupling scheme.
    outer : float
        Width of the outer zone (length).

    Raises
    ------
    BackendError
        The potential reaches beyond the outer zone, or the scheme cannot work with it.
    """
    if scheme == "force" and not pairwise:
        raise BackendError(
            f"{script}: the pair style is not one of the sums over pairs that gimpmd knows, "
            "and coupling.scheme: force needs one; use coupling.scheme: sites or velocity"
        )
    if scheme in AT_PLANES:
        return
    reach = cutoff if pairwise else 2.0 * cutoff
    if reach > outer * (1.0 + 1e-5):
        what = "pair cutoff" if pairwise else "reach of the potential, two cutoffs (not pairwise),"
        raise BackendError(
            f"{script}: the {what} {reach:g} is wider than the outer zone {outer:g}; "
            f"set coupling.zones.outer to at least {reach:g}"
        )
