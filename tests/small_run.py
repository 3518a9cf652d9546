"""Whole runs of the small case, also started by hand, and the check that bits are the same."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml

from gimpmd_deploy.results.run import Run
from tests.cases import EXAMPLE, small_case

PROGRAMS = Path(sys.executable).parent
GIMPMD = str(PROGRAMS / "gimpmd")
ENVIRONMENT = os.environ | {"PATH": os.pathsep.join([str(PROGRAMS), os.environ["PATH"]])}
"""Here the commands of gimpmd and ``mpiexec`` are found."""

SECONDS = 300.0


def write(folder: Path, end: float, **more: Any) -> Path:
    """Write the small case, with more keys, and its scripts; return the case file."""
    for script in EXAMPLE.glob("*.in"):
        (folder / script.name).write_text(script.read_text())
    case: dict[str, Any] = small_case() | more
    case["time"]["end"] = end
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(case))
    return path


def run_here(case: Path, out: Path) -> Run:
    """Run a case with ``gimpmd run``."""
    words = [GIMPMD, "run", case, "--out", out, "--no-figures"]
    subprocess.run(words, check=True, capture_output=True)
    return Run(out)


def check_same_bits(run: Run, other: Run, times: Sequence[float] = (0.0, 1.0, 2.0)) -> None:
    """Compare atoms and points at some times, and the energies as far as the first run goes."""
    assert run.outcome == "completed"
    for when in times:
        one, two = run.atoms(when), other.atoms(when)
        np.testing.assert_array_equal(one.reference, two.reference)
        np.testing.assert_array_equal(one.position, two.position)
        np.testing.assert_array_equal(one.velocity, two.velocity)
        np.testing.assert_array_equal(run.points(when).position, other.points(when).position)
    energy, longer = run.energies.energy, other.energies.energy
    # the last step of the first run is not followed by another: its last bit may differ
    count = energy.size if energy.size == longer.size else energy.size - 1
    np.testing.assert_array_equal(energy[:count], longer[:count])


class ByHand:
    """A run that is started with the commands that ``gimpmd prepare`` prints.

    At the end of a ``with`` block no service is left.

    Attributes
    ----------
    out : the run folder.
    text : what ``gimpmd prepare`` prints.
    id : the run id.
    services : the started processes, those of the ranks first and the coupler last.
    """

    def __init__(self, case: Path, out: Path, *options: str) -> None:
        self.out = out
        words = [GIMPMD, "prepare", str(case), "--out", str(out), *options]
        self.text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        lines = (line for line in self.text.splitlines() if not line.startswith("#"))
        self._setting, self._coupler, *self._ranks = lines
        words = self._coupler.split()
        self.id = words[words.index("--run") + 1]
        self._log = out.parent / f"{out.name}.log"

    def __enter__(self) -> Self:
        with self._log.open("w") as log:
            self.services = [
                subprocess.Popen(
                    ["/bin/sh", "-euc", f"{self._setting}; exec {command}"],
                    env=ENVIRONMENT,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
                for command in (*self._ranks, self._coupler)
            ]
        return self

    def __exit__(self, *_: object) -> None:
        for service in self.services:
            if service.poll() is None:
                service.terminate()
        for service in self.services:
            service.wait(SECONDS)

    @property
    def log(self) -> str:
        """What the services print."""
        return self._log.read_text()

    def wait_for_step(self) -> None:
        """Wait until a step is done."""
        while '"Progress"' not in self.log:
            assert all(service.poll() is None for service in self.services), self.log
            time.sleep(0.05)

    def finished(self) -> Run:
        """Wait for the end of all services, and open the run."""
        for service in self.services:
            assert service.wait(SECONDS) == 0, f"{service.args}: {service.returncode}\n{self.log}"
        assert '"type":"Ended"' in self.log
        return Run(self.out)
