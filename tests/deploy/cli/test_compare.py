"""``gimpmd compare``."""

import json


def test_compare_as_text_and_as_json(bench, runs):
    pair = runs / "block", runs / "block-md"
    answer = json.loads(bench.gimpmd("compare", *pair, "--json").stdout)
    assert [row["time"] for row in answer["differences"]] == [0.0, 0.4, 0.8]
    text = bench.gimpmd("compare", *pair).stdout
    assert "energy balance" in text
    assert str(runs / "block-md") in text
