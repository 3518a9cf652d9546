"""Reports and comparisons as text."""

import io

import msgspec
import pytest
from rich.console import Console

from gimpmd_deploy.results.compare import compare
from gimpmd_deploy.results.findings import RunFinding
from gimpmd_deploy.results.report import make_report
from gimpmd_deploy.results.tables import print_comparison, print_report


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=140)


def test_report(block, console):
    report = msgspec.structs.replace(
        make_report(block),
        remaining_imbalance=-1.52e-4,
        interface_loss=0.25,
        momentum=(1.0, 2.0, 3.0),
    )
    print_report(report, "lj", console)
    text = console.file.getvalue()
    assert "energy lost at the interface: 0.25 epsilon" in text
    assert "remaining imbalance at the end: -1.5e-04 of the external work" in text
    assert "(1, 2, 3) m sigma/tau at the end" in text
    assert "warning" not in text
    for word in ("block: completed", "1,560 material points", "lammps", "coupler"):
        assert word in text


def test_a_report_warns_of_findings(block, console):
    finding = RunFinding(
        step=3,
        time=1.5,
        side="md",
        kind="broken bond",
        value=1.5,
        limit=1.25,
        place=(2.0, 3.0),
        message="atoms, t = 1.5, near (2, 3): [a] defect",
    )
    print_report(msgspec.structs.replace(make_report(block), findings=(finding,)), "lj", console)
    text = " ".join(console.file.getvalue().split())
    assert "warning atoms, t = 1.5, near (2, 3): [a] defect" in text


def test_comparison(block, console):
    print_comparison(compare(block, block), console)
    text = console.file.getvalue()
    assert "sigma_yy, continuum" in text
    assert text.count("largest imbalance: ") == 2
