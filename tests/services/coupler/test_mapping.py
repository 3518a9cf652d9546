"""M ranks to N ranks: random patch layouts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimpmd_coupler.mapping import check_ids, links
from gimpmd_schemas.errors import ProtocolError


@st.composite
def layouts(draw: st.DrawFn) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Nodes dealt out to M ranks, and needs of N ranks among them, repeated or not."""
    ids = draw(st.lists(st.integers(0, 10**12), unique=True, min_size=1, max_size=40))
    m = draw(st.integers(1, 5))
    owner = draw(st.lists(st.integers(0, m - 1), min_size=len(ids), max_size=len(ids)))
    offers = [
        np.array([i for i, o in zip(ids, owner, strict=True) if o == rank], dtype=np.int64)
        for rank in range(m)
    ]
    some = st.lists(st.sampled_from(ids), max_size=60)
    needs = [np.array(draw(some), dtype=np.int64) for _ in range(draw(st.integers(1, 4)))]
    return offers, needs


@settings(deadline=None, max_examples=200)
@given(layouts(), st.sampled_from([(), (2,), (3,)]))
def test_every_rank_gets_what_it_needs(
    layout: tuple[list[np.ndarray], list[np.ndarray]], tail: tuple[int, ...]
) -> None:
    offers, needs = layout

    def content(ids: np.ndarray) -> np.ndarray:
        whole = np.multiply.outer(ids.astype(float), np.arange(1.0, 1 + np.prod(tail, dtype=int)))
        return whole.reshape(len(ids), *tail)

    for ids in needs:
        got = np.full((len(ids), *tail), np.nan)
        for rank, link in links("continuum/0", ids, dict(enumerate(offers)), "md").items():
            got[link.places] = content(offers[rank])[link.rows]
        np.testing.assert_array_equal(got, content(ids))


def test_ranks_that_offer_nothing_of_use_are_left_out() -> None:
    offers = {0: np.array([1, 2]), 1: np.array([3]), 2: np.array([], dtype=np.int64)}
    assert set(links("continuum/0", np.array([2]), offers, "md")) == {0}
    assert links("continuum/0", np.array([], dtype=np.int64), offers, "md") == {}


def test_a_node_that_nobody_offers_is_named() -> None:
    offers = {0: np.array([1, 2]), 1: np.array([3])}
    with pytest.raises(
        ProtocolError, match=r"continuum/0 needs nodes 4, 9: not offered by md/0, md/1"
    ):
        links("continuum/0", np.array([1, 9, 4]), offers, "md")


def test_a_node_that_two_offer_is_named_with_both() -> None:
    offers = {0: np.array([1, 2]), 1: np.array([7]), 2: np.array([2, 3])}
    with pytest.raises(ProtocolError, match=r"node 2, offered more than once by md/0 and md/2"):
        links("continuum/0", np.array([3, 2]), offers, "md")


def test_a_node_offered_twice_and_needed_by_nobody_does_no_harm() -> None:
    offers = {0: np.array([1, 2]), 1: np.array([2, 3])}
    found = links("continuum/0", np.array([3, 1]), offers, "md")
    assert {rank: (link.rows.tolist(), link.places.tolist()) for rank, link in found.items()} == {
        0: ([0], [1]),
        1: ([1], [0]),
    }


@pytest.mark.parametrize(
    "ids", [None, np.array([1.0]), np.array([[1]]), np.array([-1, 2]), np.array([1], dtype="i4")]
)
def test_what_is_no_list_of_nodes_is_refused(ids: np.ndarray | None) -> None:
    with pytest.raises(ProtocolError, match="md/0: array 'offers'"):
        check_ids("md/0", "offers", ids)
