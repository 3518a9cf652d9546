"""``gimpmd film``."""

import numpy as np

from gimpmd_deploy.figures import film


def test_film(bench, runs, tmp_path, monkeypatch):
    """``figures/test_film.py`` tests the pictures."""
    asked = []

    def pictures(run, field, choice):
        asked.append((run.folder, field, choice.limits))
        yield from np.random.default_rng(1).integers(0, 256, (3, 64, 48, 3), dtype=np.uint8)

    monkeypatch.setattr(film, "_pictures", pictures)
    out = tmp_path / "films" / "speed.gif"
    options = ("--field", "speed", "--limits", 0, 0.1, "--out", out)
    result = bench.gimpmd("film", runs / "block-md", *options)
    assert result.exit_code == 0, result.output
    assert result.stdout.strip() == str(out)
    assert out.stat().st_size > 10_000
    assert asked == [(runs / "block-md", "speed", (0.0, 0.1))]


def test_bad_input_writes_nothing(bench, runs, tmp_path):
    for options, message in (
        (("--field", "level", "--out", tmp_path / "x.gif"), "the run has no such field"),
        (("--out", tmp_path / "x.avi"), "is no kind of film"),
    ):
        result = bench.gimpmd("film", runs / "block-md", *options)
        assert result.exit_code == 2
        assert message in result.stderr
    assert not any(tmp_path.glob("x*"))
