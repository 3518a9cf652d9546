"""Logs of all services in one stream."""

import io

from rich.console import Console

from gimpmd_deploy.launch.merged_logs import MergedLogs
from gimpmd_deploy.launch.progress import Display, Pace


def test_lines_are_shown_once_and_whole(tmp_path):
    text = io.StringIO()
    console = Console(file=text, width=100)
    logs = {"coupler": tmp_path / "coupler.log", "md": tmp_path / "md.log"}
    with Display(console, Pace(40, 1000, "tau")) as display:
        merged = MergedLogs(console, logs, display)
        merged.tick()  # no log yet
        logs["md"].write_text("first\nhalf of the ")
        merged.tick()
        with logs["md"].open("a") as log:
            log.write("second\n")
        merged.tick()
    lines = [line.rstrip() for line in text.getvalue().splitlines()]
    assert lines == ["      md | first", "      md | half of the second"]
