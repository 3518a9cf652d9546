"""Windows in which atoms can be seen, and where they are placed."""

import msgspec
import numpy as np
import pytest

from gimpmd_deploy.figures.style import pyplot
from gimpmd_deploy.figures.windows import inside, make_layout, windows_of
from gimpmd_schemas.case.form import Crack


def test_windows_of_a_coupled_run(block):
    names = [name for name, _ in windows_of(block.plan, block.atoms())]
    assert names == ["largest stress", "interface"]
    assert windows_of(block.plan, None) == []


def test_a_crack_tip_is_looked_at(block):
    crack = Crack(start=(0.0, 40.0), end=(20.0, 40.0))
    continuum = msgspec.structs.replace(block.plan.continuum, cracks=(crack,))
    plan = msgspec.structs.replace(block.plan, continuum=continuum)
    name, window = windows_of(plan, block.atoms())[0]
    assert name == "crack tip"
    np.testing.assert_allclose(np.mean(window, axis=1), [20.0, 40.0])


def test_particles_inside(block):
    atoms = block.atoms()
    near = inside(atoms, ((10.0, 20.0), (30.0, 40.0)))
    assert 0 < len(near) < len(atoms)
    assert near.position[:, 0].max() < 20.0 + near.size[0, 0]
    assert inside(None, ((0.0, 1.0), (0.0, 1.0))) is None


@pytest.mark.parametrize("box", [((0.0, 120.0), (0.0, 80.0)), ((0.0, 10.0), (0.0, 90.0))])
def test_axes_do_not_overlap(box):
    layout = make_layout(box, 2)
    boxes = [axes.get_position() for axes in (layout.whole, *layout.details, layout.bar)]
    for k, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[k + 1 :])
    pyplot().close(layout.figure)
