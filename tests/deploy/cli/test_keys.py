"""``gimpmd keys new``."""


def test_new_keys_and_who_needs_which(bench):
    result = bench.gimpmd("keys", "new", "secret", "--host", "node7", "--host", "10.0.0.7")
    assert result.exit_code == 0, result.output
    for line in result.stdout.splitlines()[1:]:
        _, _, files = line.partition(": ")
        for file in files.split():
            assert (bench.folder / "secret" / file).is_file()
    again = bench.gimpmd("keys", "new", "secret", "--host", "node7")
    assert again.exit_code == 2
    assert "cannot be made" in again.stderr
