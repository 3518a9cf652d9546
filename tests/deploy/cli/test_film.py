"""``gimpmd film``."""


def test_film(bench, runs, tmp_path):
    out = tmp_path / "films" / "speed.gif"
    result = bench.gimpmd("film", runs / "block-md", "--field", "speed", "--out", out)
    assert result.exit_code == 0, result.output
    assert result.stdout.strip() == str(out)
    assert out.stat().st_size > 10_000


def test_bad_input_writes_nothing(bench, runs, tmp_path):
    for options, message in (
        (("--field", "level", "--out", tmp_path / "x.gif"), "the run has no such field"),
        (("--out", tmp_path / "x.avi"), "is no kind of film"),
    ):
        result = bench.gimpmd("film", runs / "block-md", *options)
        assert result.exit_code == 2
        assert message in result.stderr
    assert not any(tmp_path.glob("x*"))
