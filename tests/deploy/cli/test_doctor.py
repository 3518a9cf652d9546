"""``gimpmd doctor``."""


def test_the_way_is_checked_and_problems_count(bench):
    result = bench.gimpmd("doctor", "--connect", "tls/localhost:1", "--keys", bench.folder)
    assert result.exit_code == 2
    assert "refuses connections on port 1" in result.stdout
    assert "checks failed: connection" in result.stderr


def test_an_endpoint_without_a_port(bench):
    result = bench.gimpmd("doctor", "--connect", "tls/localhost")
    assert result.exit_code == 2
    assert "is not HOST:PORT" in result.stderr
