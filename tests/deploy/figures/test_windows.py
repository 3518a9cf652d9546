"""Windows in which atoms can be seen, and where they are placed."""

import msgspec
import numpy as np
import pytest

from gimpmd_deploy.figures.shown import show
from gimpmd_deploy.figures.style import pyplot
from gimpmd_deploy.figures.windows import INTERFACE, LARGEST, TIP, inside, make_layout, windows_of
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.case.form import Crack
from tests.deploy.figures.three_d import make_run


def found(run, particles, name="sigma_yy"):
    return windows_of(run, show(run, 0.8, particles, name), name)


def centre(window):
    return np.mean(window, axis=1)


@pytest.mark.parametrize(("place", "expected"), [((30, 35), (30, 35)), ((6, 73), (20, 60))])
def test_windows_of_a_coupled_run(block, place, expected):
    """A window at an edge of the body moves into it."""
    particles = block.particles(0.8)
    atoms = particles["md"]
    hot = np.argmin(np.linalg.norm(atoms.position - place, axis=1))
    atoms.velocity[hot] = 50.0
    windows = found(block, particles, "speed")
    assert list(windows) == [LARGEST, INTERFACE]
    np.testing.assert_allclose(centre(windows[LARGEST]), expected, atol=atoms.size[0, 0])


def test_windows_without_atoms(tmp_path):
    run = make_run(tmp_path)
    assert found(run, run.particles(0.0)) == {}


@pytest.fixture
def cracked(block):
    """The run of the block, as if its case had a crack along y = 40."""
    run = Run(block.folder)
    crack = Crack(start=(0.0, 40.0), end=(20.0, 40.0))
    continuum = msgspec.structs.replace(run.plan.continuum, cracks=(crack,))
    run.plan = msgspec.structs.replace(run.plan, continuum=continuum)
    return run


@pytest.mark.parametrize("tip", [20.0, 35.0])
def test_the_window_follows_the_crack_tip(cracked, tip):
    particles = cracked.particles(0.8)
    atoms = particles["md"]
    opened = (atoms.reference[:, 1] > 40.0) & (atoms.reference[:, 0] < tip)
    atoms.position[opened, 1] += 3.0
    x, y = centre(found(cracked, particles)[TIP])
    assert x == pytest.approx(tip, abs=atoms.size[0, 0])
    assert 39.0 < y < 43.0


def test_the_tip_of_a_crack_in_the_continuum_stays(cracked):
    particles = {"continuum": cracked.particles(0.8)["continuum"]}
    np.testing.assert_allclose(centre(found(cracked, particles)[TIP]), [20.0, 40.0])


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
