"""Every run of the paper's problems is a valid case, at full size and at a quarter of it."""

from __future__ import annotations

import pytest
import yaml

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.load import load_case
from tests.paper.__main__ import QUARTER, STUDIES
from tests.paper.jobs import EXAMPLES, Job

JOBS = [job for study in STUDIES.values() for job in study.jobs]
QUARTERS = [job.quarter() for name in QUARTER for job in STUDIES[name].jobs]


def test_names_are_unique() -> None:
    assert len({job.name for job in JOBS}) == len(JOBS)


@pytest.mark.parametrize("job", [*JOBS, *QUARTERS], ids=lambda job: job.name)
def test_case_is_valid(job: Job, tmp_path) -> None:
    for script in (EXAMPLES / job.example).glob("*.in"):
        (tmp_path / script.name).write_text(script.read_text())
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(job.case()))
    assert check_case(load_case(path), tmp_path) == []


def test_a_quarter_has_a_quarter_of_the_time_and_the_same_energy_release_rate() -> None:
    job = next(job for job in JOBS if job.name == "mode1-p015")
    full, small = job.case(), job.quarter().case()
    assert small["time"]["end"] == full["time"]["end"] / 4
    assert small["boundary"]["top"]["history"] == [[0, 0], [2.5, 1], [52.5, 1], [55, 0]]
    assert small["boundary"]["top"]["value"] == [0, 0.3]
