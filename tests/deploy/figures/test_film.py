"""Films of a field."""

import sys

import numpy as np
import pytest
from PIL import Image

from gimpmd_deploy.figures import film
from gimpmd_deploy.figures.fields import Choice
from gimpmd_deploy.figures.film import check_film, draw_film
from gimpmd_schemas.errors import BackendError, InputError

SHARES = 255.0 * np.array([10.0, 20.0, 30.0]) ** 2 / (64 * 48)
"""Mean brightness of the made-up pictures."""


@pytest.fixture
def made_up(monkeypatch):
    """Pictures of squares that grow."""

    def pictures(*_):
        for edge in (10, 20, 30):
            image = np.zeros((64, 48, 3), dtype=np.uint8)
            image[:edge, :edge] = 255
            yield image

    monkeypatch.setattr(film, "_pictures", pictures)


def test_a_picture_for_each_output_all_of_one_size(block):
    pictures = list(film._pictures(block, "velocity_x", Choice()))
    assert len(pictures) == len(block.times)
    assert len({picture.shape for picture in pictures}) == 1
    assert all(edge % 2 == 0 for edge in pictures[0].shape[:2])
    assert np.abs(pictures[0].astype(float) - pictures[-1]).max() > 50


@pytest.mark.parametrize("kind", ["gif", "png"])
def test_animations(block, made_up, tmp_path, kind):
    path = draw_film(block, "velocity_x", tmp_path / f"film.{kind}", 5.0, Choice())
    assert list(tmp_path.iterdir()) == [path]
    with Image.open(path) as opened:
        assert opened.n_frames == 3
        pictures = []
        for index in range(opened.n_frames):
            opened.seek(index)
            assert opened.info["duration"] == 200
            pictures.append(np.asarray(opened.convert("RGB")).astype(float))
    np.testing.assert_array_equal([p.mean() for p in pictures], SHARES)


def test_mp4(block, made_up, tmp_path):
    from imageio_ffmpeg import count_frames_and_secs, read_frames

    path = draw_film(block, "velocity_x", tmp_path / "film.mp4", 5.0, Choice())
    frames, seconds = count_frames_and_secs(path)
    assert (frames, seconds) == (3, pytest.approx(0.6, abs=0.1))
    size, *pictures = read_frames(path)
    assert size["size"] == (48, 64)
    shares = [np.frombuffer(picture, np.uint8).mean() for picture in pictures]
    np.testing.assert_allclose(shares, SHARES, rtol=0.1)


def test_nothing_is_half_written(block, made_up, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr(Image.Image, "save", fail)
    with pytest.raises(OSError, match="disk full"):
        draw_film(block, "velocity_x", tmp_path / "film.gif", 5.0, Choice())
    assert list(tmp_path.iterdir()) == []


def test_kinds_of_files(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"end the name with one of .mp4, .gif, .png"):
        check_film(tmp_path / "film.avi")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    check_film(tmp_path / "film.gif")
    with pytest.raises(BackendError, match="films in MP4 need imageio-ffmpeg: pip install"):
        check_film(tmp_path / "film.mp4")
