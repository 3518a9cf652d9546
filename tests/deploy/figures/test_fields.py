"""Figures of fields: which times, which colours, which files."""

import numpy as np
import pytest
from msgspec.structs import replace
from PIL import Image

from gimpmd_deploy.figures import fields
from gimpmd_deploy.figures.fields import Choice, check_names, draw_fields, looks_of, some_times
from gimpmd_deploy.figures.windows import INTERFACE, LARGEST
from gimpmd_schemas.errors import InputError
from tests.deploy.figures.three_d import make_run


def test_a_dozen_pictures_over_time(block, monkeypatch):
    times = list(np.linspace(0.0, 0.8, 30))
    monkeypatch.setattr(type(block), "times", times)
    assert some_times(block, every=True) == times
    few = some_times(block, every=False)
    assert (len(few), few[0], few[-1]) == (fields.MANY, 0.0, 0.8)


def test_files_are_named_after_field_and_output(block, tmp_path):
    drawn = draw_fields(block, ["speed", "sigma_xy"], tmp_path, block.times[1:])
    assert [path.name for path in drawn] == [
        *("speed_0001.png", "sigma_xy_0001.png"),
        *("speed_0002.png", "speed.png", "sigma_xy_0002.png", "sigma_xy.png"),
    ]
    with Image.open(tmp_path / "speed.png") as image:
        assert len(image.convert("RGB").getcolors(1 << 24)) > 100


def test_a_part_of_the_body(block, tmp_path):
    choice = Choice(limits=(-0.1, 0.2), window=((30.0, 70.0), (20.0, 60.0)))
    (look,) = looks_of(block, ["sigma_xx"], block.times, choice, block.particles)
    assert (look.box, look.windows) == (choice.window, ())
    assert (look.scale.low, look.scale.high) == (-0.1, 0.2)
    drawn = draw_fields(block, ["sigma_xx"], tmp_path, [0.0], choice)
    assert [path.name for path in drawn] == ["sigma_xx_window_0000.png"]


def test_one_scale_for_all_times_and_one_for_each_window(block):
    (look,) = looks_of(block, ["velocity_x"], block.times, Choice(), block.particles)
    each = [block.particles(time) for time in block.times]
    fastest = max(np.abs(p.velocity[:, 0]).max() for sides in each for p in sides.values())
    assert 0.3 * fastest < look.scale.high <= fastest
    assert set(look.close) == {LARGEST}
    assert {LARGEST, INTERFACE} <= set(look.windows)


def test_axes_follow_a_body_that_moves(block):
    particles = block.particles(0.8)
    for p in particles.values():
        p.position[:, 0] += 50.0
    (look,) = looks_of(block, ["speed"], [0.8], Choice(), lambda _: particles)
    assert look.box[0][0] == 0.0
    assert look.box[0][1] == pytest.approx(170.0, abs=2.0)


def test_names_of_fields(block):
    check_names(block, ["sigma_yy", "level", "temperature"])
    with pytest.raises(InputError, match=r"'sigma_zz'.*no such field\n.*it has sigma_xx, "):
        check_names(block, ["sigma_yy", "sigma_zz"])


def test_fields_that_a_run_lacks_are_left_out(tmp_path):
    run = make_run(tmp_path)
    output = replace(run.case.output, figures=("potential_energy", "speed"))
    run.case = replace(run.case, output=output)
    names = [path.name for path in fields.draw_chosen(run, tmp_path, False)]
    assert names == ["speed_0000.png", "speed.png"]
