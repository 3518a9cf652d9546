"""docs/paper.md, from the rows that the studies measured."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from gimpmd_deploy.figures.fields import Choice, draw_fields
from gimpmd_deploy.figures.windows import Window
from gimpmd_deploy.results.run import Run
from tests.paper.jobs import Job

DOCS = Path(__file__).resolve().parents[2] / "docs"

HEAD = """\
# The paper's problems at full size

Section 5 of Ma et al. (`examples/mode1`, `examples/friction`): what the paper reports beside what
gimpmd measures. `make paper` runs everything (hours on two cores) and writes this page; a run that
was completed before is not repeated. All quantities are in reduced Lennard-Jones units.
"""

PIXELS = 1300
"""Largest edge of a picture in the documentation, which keeps its file small."""


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
    text : paragraphs that explain the table, and what differs from the paper and why.
    rows : of the table.
    figures : images, with captions.
    """

    title: str
    text: str
    rows: Sequence[Row]
    figures: Sequence[tuple[Path, str]] = ()


def picture(
    run: Run,
    field: str,
    time: float,
    folder: Path,
    limits: tuple[float, float],
    window: Window | None = None,
) -> Path:
    """Draw a field of a run at one output; returns the file in the folder of images."""
    at = min(run.times, key=lambda output: abs(output - time))
    zoom = "" if window is None else "-window"
    path = folder / "images" / f"{run.folder.name}-{field}-t{time:g}{zoom}.png"
    with tempfile.TemporaryDirectory() as temporary:
        choice = Choice(limits, window)
        drawn = draw_fields(run, [field], Path(temporary), [at], choice)
        shutil.move(drawn[0], path)
    return path


def changes_of(job: Job) -> str:
    """Return the changes of a case as the page shows them."""
    return ", ".join(f"`{key}: {json.dumps(value)}`" for key, value in job.changes.items()) or "-"


def keep(
    docs: Path, name: str, result: Result, jobs: Sequence[Job], runs: Mapping[str, Run]
) -> None:
    """Store what a study found, for this page and later ones."""
    (docs / "paper").mkdir(exist_ok=True)
    (docs / "figures").mkdir(exist_ok=True)
    stored = asdict(result)
    stored["figures"] = [(_shrunk(image, docs), caption) for image, caption in result.figures]
    stored["runs"] = [
        (job.name, job.command, changes_of(job), runs[job.name].seconds) for job in jobs
    ]
    (docs / "paper" / f"{name}.json").write_text(json.dumps(stored, indent=1) + "\n")


def _shrunk(image: Path, docs: Path) -> str:
    """Copy an image to the figures of the documentation, not too large; returns its name."""
    from PIL import Image

    name = f"paper-{image.name}"
    with Image.open(image) as full:
        shown = full.convert("RGB")
    shown.thumbnail((PIXELS, PIXELS))
    shown.save(docs / "figures" / name, optimize=True)
    return name


def write(docs: Path, names: Sequence[str]) -> None:
    """Write the page from the studies that have been run; the others are named."""
    parts, missing = [HEAD], []
    for name in names:
        path = docs / "paper" / f"{name}.json"
        if path.is_file():
            parts.append(_section(name, json.loads(path.read_text())))
        else:
            missing.append(f"`{name}`")
    if missing:
        parts.append(f"Not run yet: {', '.join(missing)}.\n")
    (docs / "paper.md").write_text("\n".join(parts))


def _section(name: str, result: dict) -> str:
    lines = [f"## {result['title']}", "", result["text"].strip(), ""]
    lines += ["| paper | quantity | paper's value | gimpmd | run |", "|---|---|---|---|---|"]
    for row in result["rows"]:
        cells = (row["figure"], row["quantity"], row["paper"], row["ours"], f"`{row['run']}`")
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", f"All of this: `python -m tests.paper {name}`."]
    if result["runs"]:
        lines += [
            "",
            "| run | command | changes of the case | wall time (s) |",
            "|---|---|---|---|",
        ]
    for run, command, changes, seconds in result["runs"]:
        lines.append(f"| `{run}` | `{command}` | {changes} | {seconds:.0f} |")
    for image, caption in result["figures"]:
        lines += ["", f"![{caption}](figures/{image})", "", caption]
    return "\n".join([*lines, ""])
