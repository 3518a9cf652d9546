"""Index maps from the nodes that M ranks offer to the nodes that N ranks need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.messages import Array

_SHOWN = 5  # node ids listed in a refusal


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


def index_map(needer: str, needs: Ints, offers: Mapping[str, Ints]) -> Ints:
    """Return the position of each needed node in the joined offers of all ranks.

    Parameters
    ----------
    needer : str
        Name of the rank that needs.
    needs : ndarray of int64, shape ``(n,)``
        Node ids.
    offers : mapping of rank names to ndarray of int64
        Node ids that each rank of the other side offers, in the order of the ranks.

    Returns
    -------
    ndarray of int64, shape ``(n,)``

    Raises
    ------
    ProtocolError
        A needed node is not offered, or offered more than once.
    """
    offered = np.concatenate([*offers.values(), np.empty(0, dtype=np.int64)])
    order = np.argsort(offered, kind="stable")
    ordered = offered[order]
    low = np.searchsorted(ordered, needs, side="left")
    count = np.searchsorted(ordered, needs, side="right") - low
    if np.any(count == 0):
        missing = _nodes(np.unique(needs[count == 0]))
        raise ProtocolError(f"{needer} needs {missing}: not offered by {_names(offers)}")
    if np.any(count > 1):
        double = np.unique(needs[count > 1])
        owners = [who for who, ids in offers.items() if np.isin(double, ids).any()]
        raise ProtocolError(
            f"{needer} needs {_nodes(double)}, offered more than once by {' and '.join(owners)}"
        )
    return np.asarray(order[low], dtype=np.int64)


def _names(offers: Mapping[str, Any]) -> str:
    names = list(offers)
    return f"{names[0]} ... {names[-1]}" if len(names) > 3 else ", ".join(names)


def gather(parts: Sequence[Mapping[str, Array]], field: str, index: Ints) -> Array:
    """Return the values of a field on the needed nodes.

    Parameters
    ----------
    parts : sequence
        Fields of all ranks, in the same order as the offers given to ``index_map``.
    field : str
    index : ndarray of int64, shape ``(n,)``

    Returns
    -------
    ndarray, shape ``(n, ...)``
    """
    whole = parts[0][field] if len(parts) == 1 else np.concatenate([p[field] for p in parts])
    return np.take(whole, index, axis=0)
