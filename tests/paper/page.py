"""docs/paper.md, from the rows that the studies measured."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from gimpmd_deploy.results.run import Run
from tests.paper.jobs import Job

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, ROWS = DOCS / "paper.md", DOCS / "paper"

HEAD = """\
# The paper's problems at full size

Section 5 of Ma et al. (`examples/mode1`, `examples/friction`): what the paper reports beside what
gimpmd measures. `make paper` runs everything (hours on two cores) and writes this page; a run that
was completed before is not repeated. All quantities are in reduced Lennard-Jones units.
"""


@dataclass(frozen=True)
class Row:
    """One number of the paper and ours.

    Attributes
    ----------
    figure : figure or section of the paper.
    quantity : what is measured, and by which rule.
    paper : the paper's value; "-" where it gives none.
    ours : measured.
    run : name of the run.
    """

    figure: str
    quantity: str
    paper: str
    ours: str
    run: str


@dataclass(frozen=True)
class Result:
    """What a study found.

    Attributes
    ----------
    title : of its section.
    text : a paragraph that explains the table, and what differs from the paper and why.
    rows : of the table.
    runs : for each run its command, its changes of the case, and its wall time (s).
    figures : images in the folder of this page's figures, with captions.
    """

    title: str
    text: str
    rows: Sequence[Row]
    runs: Sequence[tuple[str, str, str, float]]
    figures: Sequence[tuple[str, str]] = ()


def runs_of(jobs: Sequence[Job], runs: Mapping[str, Run]) -> list[tuple[str, str, str, float]]:
    """What the page says about the runs of a study."""
    return [
        (job.name, job.command, changes_of(job), runs[job.name].seconds or float("nan"))
        for job in jobs
    ]


def changes_of(job: Job) -> str:
    """Return the changes of a case as the page shows them."""
    return ", ".join(f"`{key}: {json.dumps(value)}`" for key, value in job.changes.items()) or "none"


def keep(name: str, result: Result) -> None:
    """Store what a study found, for this page and later ones."""
    ROWS.mkdir(exist_ok=True)
    (ROWS / f"{name}.json").write_text(json.dumps(asdict(result), indent=1) + "\n")


def write(names: Sequence[str]) -> None:
    """Write the page from the studies that have been run; the others are named."""
    parts, missing = [HEAD], []
    for name in names:
        path = ROWS / f"{name}.json"
        if path.is_file():
            parts.append(_section(json.loads(path.read_text())))
        else:
            missing.append(name)
    if missing:
        parts.append(f"Not run yet: {', '.join(missing)}.\n")
    PAGE.write_text("\n".join(parts))


def _section(result: dict) -> str:
    lines = [f"## {result['title']}", "", result["text"].strip(), ""]
    lines += ["| paper | quantity | paper's value | gimpmd | run |", "|---|---|---|---|---|"]
    for row in result["rows"]:
        cells = (row["figure"], row["quantity"], row["paper"], row["ours"], f"`{row['run']}`")
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| run | command | changes of the case | wall time (s) |", "|---|---|---|---|"]
    for name, command, changes, seconds in result["runs"]:
        lines.append(f"| `{name}` | `{command}` | {changes} | {seconds:.0f} |")
    for image, caption in result["figures"]:
        lines += ["", f"![{caption}](figures/{image})", "", caption]
    return "\n".join([*lines, ""])
