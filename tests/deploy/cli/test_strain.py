"""``gimpmd strain dump``: the MD service is started on a dump."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gimpmd_deploy.cli.app import app

HEAD = """ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
36
ITEM: BOX BOUNDS ss ss pp
0 5
0 5
-0.5 0.5
ITEM: ATOMS id x y z
"""


@pytest.fixture
def dump(tmp_path: Path) -> Path:
    """A square of atoms at rest, and stretched by a hundredth along x."""
    path = tmp_path / "atoms.dump"
    with path.open("w") as file:
        for step, stretch in ((0, 1.0), (10, 1.01)):
            file.write(HEAD.format(step=step))
            file.writelines(
                f"{6 * i + j + 1} {stretch * i} {j} 0\n" for i in range(6) for j in range(6)
            )
    return path


def call(*words: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["strain", "dump", *map(str, words)])
    return done.exit_code, done.stdout, done.stderr


@pytest.mark.parametrize("ranks", [1, 2])
def test_strains_are_written_beside_the_dump(dump: Path, ranks: int) -> None:
    code, said, error = call(dump, "--method", "total", "--ranks", ranks)
    assert code == 0, error
    out = dump.with_name("atoms.strain.dump")
    assert f"{out}: strain_xx, strain_yy, strain_xy of 36 atoms in 2 frames" in said
    rows = out.read_text().splitlines()[-36:]
    for row in rows:
        xx, yy, xy = map(float, row.split()[-3:])
        assert xx == pytest.approx(0.01)
        assert (yy, xy) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_json_and_undefined_atoms(dump: Path) -> None:
    code, said, _ = call(dump, "--method", "virial", "--json")
    assert code == 0
    assert json.loads(said)["undefined"] == 16  # the faces; two neighbours of a corner serve
    code, said, _ = call(dump, "--method", "virial", "--force")
    assert (
        "16 atoms of the last frame have no strain (nan): their neighbours lie on one side" in said
    )


def test_an_output_that_exists_is_kept(dump: Path) -> None:
    kept = dump.with_name("atoms.strain.dump")
    kept.write_text("mine")
    code, _, error = call(dump)
    assert code == 2
    assert "--out: exists already" in error
    assert "--force" in error
    assert kept.read_text() == "mine"
    assert call(dump, "--force")[0] == 0
    assert kept.read_text() != "mine"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cell", "0.3"), "cell = 0.3: is smaller than an atom"),
        (("--reference", "-5", "--ranks", "2"), "reference = -5: is not a step of it"),
        (("--out", "none/out.dump"), "none is not a folder"),
    ],
)
def test_bad_input(dump: Path, options: tuple[str, ...], words: str) -> None:
    code, said, error = call(dump, *options)
    assert code == 2
    assert said == ""
    assert error.startswith("error: ")
    assert words in error
    assert "gimpmd-md" not in error
