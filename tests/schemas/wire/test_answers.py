"""Answers of helper commands: what the MD service prints is what deploy reads."""

from __future__ import annotations

import msgspec
import pytest

from gimpmd_schemas.case.materials import Elastic
from gimpmd_schemas.wire.answers import Probe, Repeat, StrainSummary, Surfaces

ANSWERS = [
    Probe(),
    Probe(
        atoms=12,
        mass=24.0,
        cutoff=2.5,
        spacing=1.1,
        material=Elastic(density=0.93, lame=27.8, shear=27.8),
    ),
    Repeat(low=(0.0, 1.0), size=(2.0, 3.0), period=(1.0, 1.5)),
    Repeat(low=(0.0, 0.0, 0.0), size=(2.0, 2.0, 2.0), period=(1.0, 1.0, 2.0)),
    Surfaces(unrelaxed=(1.2, 1.1), relaxed=(1.1, 1.0)),
    StrainSummary(
        method="total",
        columns=["strain_xx", "strain_yy", "strain_xy"],
        atoms=10,
        frames=2,
        dimension=2,
        reference=0,
        distance=1.1,
        cell=None,
        cutoff=1.3,
        undefined=0,
    ),
]


@pytest.mark.parametrize("answer", ANSWERS)
def test_answers_survive_json(answer: Probe | Repeat | StrainSummary | Surfaces) -> None:
    assert msgspec.json.decode(msgspec.json.encode(answer), type=type(answer)) == answer


def test_an_incomplete_answer_is_refused() -> None:
    with pytest.raises(msgspec.ValidationError, match="period"):
        msgspec.json.decode(b'{"low": [0, 0], "size": [1, 1]}', type=Repeat)
