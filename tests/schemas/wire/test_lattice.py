"""Question and answer about a crystal: what one side writes is what the other reads."""

from __future__ import annotations

import msgspec
import pytest

from gimpmd_schemas.wire.lattice import Crystal, Potential, Question, Surface, Waves

COPPER = Potential(
    structure="fcc", units="metal", pair_style="eam/alloy", pair_coeff=("* * Cu.eam Cu",)
)
CRYSTAL = Crystal(
    units="lj",
    dimension=2,
    structure="hex",
    constant=1.1,
    ratio=None,
    factors=None,
    edges=((1.1, 0.0), (0.0, 1.9)),
    neighbours=1.1,
    energy=-3.3,
    density=0.93,
    stiffness=((3.0, 1.0, 0.0), (1.0, 3.0, 0.0), (0.0, 0.0, 1.0)),
    waves=(Waves(direction="x", speeds=(9.5, 5.5)),),
    surfaces=(Surface(plane="close-packed rows", unrelaxed=1.1, relaxed=1.0),),
)


@pytest.mark.parametrize("message", [Question(script="a.in"), Question(potential=COPPER), CRYSTAL])
def test_they_survive_json(message: Question | Crystal) -> None:
    assert msgspec.json.decode(msgspec.json.encode(message), type=type(message)) == message
