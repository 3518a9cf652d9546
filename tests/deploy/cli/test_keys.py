"""``gimpmd keys new``."""


def test_new_keys_and_who_needs_which(bench):
    hosts = "--host", "node7", "--host", "10.0.0.7"
    result = bench.gimpmd("keys", "new", "secret", *hosts, "--ranks-md", "3")
    assert result.exit_code == 0, result.output
    assert "\n  md/2: authority.pem md-2.pem md-2.key md.password\n" in result.stdout
    for line in result.stdout.splitlines()[1:]:
        _, _, files = line.partition(": ")
        for file in files.split():
            assert (bench.folder / "secret" / file).is_file()
    again = bench.gimpmd("keys", "new", "secret", "--host", "node7")
    assert again.exit_code == 2
    assert "cannot be made" in again.stderr
