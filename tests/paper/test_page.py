"""The page holds the rows of the studies that have been run, and names the others."""

from __future__ import annotations

import re
from types import SimpleNamespace

from tests.paper import page
from tests.paper.jobs import Job
from tests.paper.page import Result, Row


def test_rows_commands_and_figures_reach_the_page(tmp_path) -> None:
    from PIL import Image

    image = tmp_path / "stress.png"
    Image.new("RGB", (4, 4), "red").save(image)
    job = Job("a", "mode1", {"time.end": 64}, ("--only", "md"))
    result = Result("Title", "Text.", [Row("12", "load", "8 %", "7 %", "a")], [(image, "Caption.")])
    page.keep(tmp_path, "one", result, [job], {"a": SimpleNamespace(seconds=12.4)})
    page.write(tmp_path, ["one", "other"])
    text = (tmp_path / "paper.md").read_text()
    assert "| 12 | load | 8 % | 7 % | `a` |" in text
    assert "| `a` | `gimpmd run examples/mode1/case.yaml --only md` | `time.end: 64` | 12 |" in text
    assert "Not run yet: `other`." in text
    (shown,) = re.findall(r"!\[Caption\.\]\((.*)\)", text)
    assert (tmp_path / shown).is_file()
