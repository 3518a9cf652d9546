"""Options of the command line that cannot be understood."""

import pytest


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--only", "foo"), ("--only", "'foo'", "md", "continuum")),
        (("--ranks-md", "0"), ("--ranks-md", "greater than or equal to 1")),
        (("--ranks-md", "two"), ("--ranks-md", "integer")),
        (("--colour", "red"), ("--colour",)),
    ],
)
def test_bad_options(bench, options, words):
    result = bench.gimpmd("run", bench.write(), *options)
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert not bench.runs.exists()
