"""A film of a field over the outputs of a run: MP4, animated GIF or animated PNG."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.figures.fields import Choice, looks_of
from gimpmd_deploy.figures.picture import draw_picture
from gimpmd_deploy.figures.shown import show
from gimpmd_deploy.figures.style import FILM_DPI, pyplot
from gimpmd_deploy.figures.windows import TIP
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.errors import BackendError, InputError, Problem

Image = Any
"""Array of bytes, shape ``(rows, columns, 3)``."""

KINDS = (".mp4", ".gif", ".png")


def check_film(path: Path) -> None:
    """Refuse a file of another kind, and MP4 without the library that writes it.

    Raises
    ------
    InputError
        The name of the file does not end with one of `KINDS`.
    BackendError
        imageio-ffmpeg is not installed.
    """
    if path.suffix not in KINDS:
        message, hint = "is no kind of film", f"end the name with one of {', '.join(KINDS)}"
        raise InputError("command line", [Problem("--out", str(path), message, hint)])
    if path.suffix == ".mp4":
        try:
            import imageio_ffmpeg  # noqa: F401
        except ImportError:
            hint = "pip install 'gimpmd[viz]', or give --out a name that ends with .gif or .png"
            raise BackendError(f"films in MP4 need imageio-ffmpeg: {hint}") from None


def draw_film(run: Run, name: str, path: Path, rate: float, choice: Choice) -> Path:
    """Draw a field at every output, and write the pictures as a film.

    Only the window at a crack tip is drawn beside the body, because others may jump.

    Parameters
    ----------
    name : str
        A field that the run has.
    path : Path
        The film; its suffix is one of `KINDS`.
    rate : float
        Outputs per second.
    choice : Choice
        Colour scale and part of the body.
    """
    pictures = _pictures(run, name, choice)
    part = path.with_name(f".{path.name}.part{path.suffix}")  # so that no film is half written
    try:
        if path.suffix == ".mp4":
            _write_mp4(pictures, part, rate)
        else:
            _write_animation(pictures, part, rate)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path


def _pictures(run: Run, name: str, choice: Choice) -> Iterator[Image]:
    """Draw the pictures one after the other."""
    only_tip = Choice(choice.limits, choice.window, (TIP,))
    (look,) = looks_of(run, [name], run.times, only_tip, run.particles)
    for time in run.times:
        figure = draw_picture(run, show(run, time, run.particles(time), name), look, FILM_DPI)
        figure.canvas.draw()
        image = np.asarray(figure.canvas.buffer_rgba())[:, :, :3]
        pyplot().close(figure)
        rows, columns = (n - n % 2 for n in image.shape[:2])  # codecs want even numbers
        yield np.ascontiguousarray(image[:rows, :columns])


def _write_mp4(pictures: Iterator[Image], path: Path, rate: float) -> None:
    from imageio_ffmpeg import write_frames

    first = next(pictures)
    size = (first.shape[1], first.shape[0])
    film = write_frames(path, size, fps=rate, quality=8, macro_block_size=2)
    film.send(None)
    for image in (first, *pictures):
        film.send(image)
    film.close()


def _write_animation(pictures: Iterable[Image], path: Path, rate: float) -> None:
    from PIL.Image import fromarray

    first, *others = (fromarray(image) for image in pictures)
    first.save(path, save_all=True, append_images=others, duration=1000.0 / rate, loop=0)
