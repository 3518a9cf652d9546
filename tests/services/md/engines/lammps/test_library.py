"""What the engine says of pair styles, against the forces of LAMMPS on two atoms."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.errors import BackendError
from tests.small_disk import on_a_small_disk

OF_DISTANCE = {
    "beck 2.5": "400 0.003 4.4 0.004 0.7",
    "born 2.5": "6 0.3 1.2 24 1",
    "born/gauss 2.5": "1000 4 1 2 1",
    "buck 2.5": "100 0.3 2",
    "buck/mdf 1.8 2.5": "100 0.3 2",
    "colloid 2.5": "5 1 0 0 2.5",
    "cosine/squared 2.5": "1 1.1 2.5 wca",
    "gauss 2.5": "1 2",
    "gauss/cut 2.5": "1 1.1 0.3",
    "harmonic/cut": "100 1.5",
    "lennard/mdf 1.8 2.5": "4 4",
    "lepton 2.5": "'4*(r^-12-r^-6)'",
    "lj/class2 2.5": "1 1",
    "lj/class2/soft 2 0.5 2.5": "1 1 0.9",
    "lj/cut 2.5": "1 1",
    "lj/cut/opt 2.5": "1 1",
    "lj/cut/soft 2 0.5 2.5": "1 1 0.9",
    "lj/expand 2.5": "1 1 0.1",
    "lj/gromacs 1.8 2.5": "1 1",
    "lj/mdf 1.8 2.5": "1 1",
    "lj/pirani 2.5": "9 0 6 1.2 1 2.5",
    "lj/relres 1.5 1.8 2.2 2.5": "1 1 0.5 1",
    "lj/sdk 2.5": "lj9_6 1 1",
    "lj/sf 2.5": "1 1",
    "lj/smooth 1.8 2.5": "1 1",
    "lj/smooth/linear 2.5": "1 1",
    "lj/spica 2.5": "lj9_6 1 1",
    "lj96/cut 2.5": "1 1",
    "mie/cut 2.5": "1 1 10 5",
    "momb 2.5 0.75 20": "0.1 1 1 1 1",
    "morse 2.5": "1 5 1.1",
    "morse/smooth/linear 2.5": "1 5 1.1",
    "morse/soft 4 0.9 2.5": "1 5 1.1 1",
    "nm/cut 2.5": "1 1.1 9 6",
    "nm/cut/split 2.5": "1 1.1 9 6",
    "pedone 2.5": "1 3 1.1 1",
    "soft 2.5": "10",
    "table spline 2000": "lj.table LJ",
    "ufm 2.5": "10 1",
    "wf/cut 2.5": "1 1 1 1",
    "yukawa 1 2.5": "1",
    "zbl 2 2.5": "3 3",
}
"""Commands: style with its settings, and coefficients."""

OF_MORE = ["lj/cut/coul/cut", "buck/coul/cut/omp", "lj/cut/dipole/cut", "yukawa/colloid"]
OF_MANY = ["sw", "eam/alloy", "lj/cut/coul/long", "lj/cut/tip4p/cut", "dpd", "born/coul/msm"]


@pytest.fixture
def two_atoms(folder: Path) -> Iterator[Engine]:
    """Two atoms, and the Lennard-Jones potential as a table of 2000 distances."""
    engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
    engine.commands(
        [
            "units lj",
            "dimension 2",
            "region box block 0 20 0 20 -0.5 0.5",
            "create_box 1 box",
            "create_atoms 1 single 5 5 0",
            "create_atoms 1 single 6 5 0",
            "mass 1 1",
            "pair_style lj/cut 2.5",
            "pair_coeff 1 1 1 1",
            "run 0 post no",
            "pair_write 1 1 2000 rsq 0.9 2.5 lj.table LJ",
        ]
    )
    yield engine
    engine.close()


@pytest.mark.parametrize("style", OF_DISTANCE)
def test_what_pair_write_tells_is_the_force(two_atoms: Engine, style: str) -> None:
    two_atoms.commands([f"pair_style {style}", f"pair_coeff 1 1 {OF_DISTANCE[style]}"])
    assert two_atoms.is_of_distance()
    assert two_atoms.is_pairwise()
    two_atoms.commands(["run 0 post no"])
    table = two_atoms.pair_table(1, 1, 1.0, 2.4, 20)
    along = np.array([0.6, 0.8])
    size = np.abs(table[:, 2]).max()
    for distance, _, force in table:
        x = two_atoms.vectors("x")
        x[1] = x[0] + distance * along
        two_atoms.commands(["run 0 post no"])
        np.testing.assert_allclose(two_atoms.vectors("f")[1], force * along, atol=1e-12 * size)


def test_a_hybrid_is_what_its_styles_are(two_atoms: Engine) -> None:
    two_atoms.commands(["pair_style hybrid/overlay lj/cut 2.5 lj/cut/opt 2.0 soft 2.0"])
    assert two_atoms.pair_styles() == ["lj/cut", "lj/cut", "soft"]
    assert two_atoms.is_of_distance()
    two_atoms.commands(["pair_style hybrid lj/cut 2.5 eam/alloy"])
    assert two_atoms.pair_styles() == ["lj/cut", "eam/alloy"]
    assert not two_atoms.is_pairwise()


@pytest.mark.parametrize("style", [*OF_MORE, *OF_MANY])
def test_other_sums_over_pairs(
    two_atoms: Engine, monkeypatch: pytest.MonkeyPatch, style: str
) -> None:
    """Charges and the like are for the velocity scheme alone."""
    monkeypatch.setattr(two_atoms.lammps, "extract_global", lambda name: style)
    assert not two_atoms.is_of_distance()
    assert two_atoms.is_pairwise() == (style in OF_MORE)


def test_the_log_keeps_its_start_and_does_not_grow_without_bound(two_atoms: Engine) -> None:
    two_atoms.bound_log(5_000)
    start = two_atoms.log.read_text()
    for _ in range(100):
        two_atoms.commands(["run 1 pre no post no"])
        two_atoms.lammps.flush_buffers()
        two_atoms.trim_log()
    said = two_atoms.log.read_text()
    assert said.startswith(start)
    assert "run 1 pre no post no" in said[len(start) :]
    assert "\0" not in said
    assert len(said) < len(start) + 6_000


FILL = """
import sys
from pathlib import Path
from mpi4py import MPI
from gimpmd_md.engines.lammps.library import Engine
engine = Engine(MPI.COMM_SELF, Path(sys.argv[1]) / "log.lammps")
engine.commands(sys.argv[2:])
print(len(engine.pair_table(1, 1, 0.9, 2.5, 500)))
"""


@pytest.mark.parametrize(("size", "whole"), [("1m", True), ("16k", False)])
def test_a_table_without_its_end_is_a_full_disk(tmp_path: Path, size: str, whole: bool) -> None:
    """LAMMPS writes 32 KB, and does not say that they did not fit."""
    lines = [
        "units lj",
        "region box block 0 4 0 4 0 4",
        "create_box 1 box",
        "mass 1 1",
        "pair_style lj/cut 2.5",
        "pair_coeff 1 1 1 1",
    ]
    words = [sys.executable, "-c", FILL, str(tmp_path), *lines]
    done = subprocess.run(
        on_a_small_disk(tmp_path, size, *words), capture_output=True, text=True, check=False
    )
    if whole:
        assert done.stdout == "500\n", done.stderr
    else:
        said = f"StorageError: {tmp_path / 'log.pair'} cannot be written: No space left on device"
        assert done.stderr.strip().endswith(said), done.stderr


SI_BOX = "units si\nregion box block 0 1e-9 0 1e-9 0 1e-9 units box\ncreate_box 1 box\n"


def test_the_default_skin_of_si_units_is_refused(tmp_path: Path) -> None:
    """LAMMPS would look for neighbours within 1 mm, and take all memory."""
    script = tmp_path / "cell.in"
    script.write_text(SI_BOX)
    engine = Engine(MPI.COMM_SELF, tmp_path / "log")
    try:
        with pytest.raises(BackendError, match=r"within 1 mm.*add 'neighbor 2e-10 bin'"):
            engine.script(str(script), {})
        script.write_text("clear\n" + SI_BOX + "variable skin index 1e-10\nneighbor ${skin} bin\n")
        engine.script(str(script), {})
    finally:
        engine.close()
