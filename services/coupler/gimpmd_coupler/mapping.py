"""Which nodes that one rank offers go where in the nodes that another rank needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.messages import Array

_SHOWN = 5  # node ids listed in a refusal


@dataclass(frozen=True, eq=False)
class Link:
    """Nodes that a rank takes from one rank of the other side.

    Attributes
    ----------
    rows : ndarray of int64, shape ``(n,)``
        Rows in the fields of the other rank.
    places : ndarray of int64, shape ``(n,)``
        Their rows in the fields that this rank needs.
    """

    rows: Ints
    places: Ints

    @cached_property
    def least(self) -> int:
        """Number of rows that the fields of the other rank have at least."""
        return int(self.rows.max(initial=-1)) + 1


def _nodes(ids: Ints) -> str:
    """Name the first few node ids and the number of the others."""
    shown = ", ".join(str(node) for node in ids[:_SHOWN])
    more = f" and {len(ids) - _SHOWN} more" if len(ids) > _SHOWN else ""
    return f"node{'s' if len(ids) > 1 else ''} {shown}{more}"


def check_ids(who: str, kind: str, ids: Array | None) -> Ints:
    """Return the node ids of a registration after checking them.

    Raises
    ------
    ProtocolError
        They are missing, not a list of int64, or negative.
    """
    if ids is None or ids.dtype != np.int64 or ids.ndim != 1:
        what = "nothing" if ids is None else f"{ids.dtype} of shape {ids.shape}"
        raise ProtocolError(f"{who}: array {kind!r} must be int64 of shape (n,), got {what}")
    if ids.size and ids.min() < 0:
        raise ProtocolError(f"{who}: array {kind!r} holds node {ids.min()}, ids begin with 0")
    return ids


def links(needer: str, needs: Ints, offers: Mapping[int, Ints], role: str) -> dict[int, Link]:
    """Find the ranks of the other side from which a rank takes its nodes.

    Parameters
    ----------
    needer : str
        Name of the rank that needs.
    needs : ndarray of int64, shape ``(n,)``
        Node ids.
    offers : mapping of ranks to ndarray of int64
        Node ids that each rank of the other side offers.
    role : str
        Role of the other side, for messages.

    Returns
    -------
    dict of Link by rank
        Only ranks that offer a needed node.

    Raises
    ------
    ProtocolError
        A needed node is not offered, or offered more than once.
    """
    ranks = np.repeat(list(offers), [ids.size for ids in offers.values()])
    offered = np.concatenate([*offers.values(), np.empty(0, dtype=np.int64)])
    rows = np.concatenate([np.empty(0, np.int64), *(np.arange(v.size) for v in offers.values())])
    order = np.argsort(offered, kind="stable")
    ordered = offered[order]
    low = np.searchsorted(ordered, needs, side="left")
    count = np.searchsorted(ordered, needs, side="right") - low
    if np.any(count == 0):
        missing = _nodes(np.unique(needs[count == 0]))
        raise ProtocolError(f"{needer} needs {missing}: not offered by {_names(role, offers)}")
    if np.any(count > 1):
        double = np.unique(needs[count > 1])
        owners = [f"{role}/{k}" for k, ids in offers.items() if np.isin(double, ids).any()]
        raise ProtocolError(
            f"{needer} needs {_nodes(double)}, offered more than once by {' and '.join(owners)}"
        )
    chosen = order[low]
    return {
        int(rank): Link(rows[chosen[ranks[chosen] == rank]], np.flatnonzero(ranks[chosen] == rank))
        for rank in np.unique(ranks[chosen])
    }


def _names(role: str, offers: Mapping[int, Ints]) -> str:
    names = [f"{role}/{rank}" for rank in offers]
    return f"{names[0]} ... {names[-1]}" if len(names) > 3 else ", ".join(names)
