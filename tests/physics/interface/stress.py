"""What nobody tuned for: atoms off the centre of a plate, an oblique shear wave, N = 7, patches.

The plate is 60 by 44 cells with free rims; the MD region is 21 by 13 cells, nearer to the left
and to the lower side, its faces on no node lines. A shear packet of 20 cells at 27 degrees runs
over it. The same body of atoms alone says what is right.
"""

from __future__ import annotations

from typing import Any

from gimpmd_deploy.results.compare import compare
from tests.physics.gimp.gates import Check
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import COMPARED, SCHEMES, SOURCE, SchemeName, coupled
from tests.physics.strips import OFTEN, H, energies, strip_case

PLATE = (60, 44)
REGION = ((13.3, 34.3), (9.6, 22.6))
END, LOOK = 20.0, 14.0
"""The packet is compared while it is among the atoms; later little is left there to compare."""


def plate(scheme: SchemeName) -> dict[str, Any]:
    case = coupled(strip_case(20.0, "into", md_steps=7, md_timestep=0.01), scheme)
    case["name"] = "stress"
    case["domain"] = {"box": [[0.0, n * H] for n in PLATE], "periodic": [False, False]}
    case["md"] |= {
        "region": [[low * H, high * H] for low, high in REGION],
        "ranks": 3,
        "patches": [3, 1],
        "minimize": True,  # the rims of the atoms alone
    }
    case["boundary"] = {}
    case["time"]["end"] = END
    case["output"] = {"interval": LOOK, "energy_interval": OFTEN}
    packet = case["initial"]["packets"][0]
    packet |= {"center": 10.0 * H, "polarization": "S", "tilt": 27.0, "cycles": 1.0, "direction": 1}
    return case


def stress(scheme: SchemeName) -> list[Check]:
    """The coupled plate is about as near to the atoms alone as the grid alone is.

    The grid's waves are slow and its rims are other than those of the atoms: that is most of it.
    """
    case = plate(scheme)
    runs = run_all(
        [
            ("md", case | {"only": "md"}, ()),
            ("coupled", case, ()),
            ("grid", case | {"only": "continuum"}, ()),
        ]
    )
    bounds, total = SCHEMES[scheme], sum(energies(runs["coupled"]))
    ours = compare(runs["coupled"], runs["md"]).differences[1]
    grid = compare(runs["grid"], runs["md"]).differences[1]
    assert ours.displacement_md is not None
    assert ours.displacement_continuum is not None
    assert grid.displacement_continuum is not None
    return [
        Check("plate, largest E/E0 - 1", total.max() - 1.0, high=bounds.broadband, source=SOURCE),
        Check("plate, grid alone, L2 of u", grid.displacement_continuum, source=COMPARED),
        Check(
            "plate, L2 of u in the continuum",
            ours.displacement_continuum,
            high=1.1 * grid.displacement_continuum,
            source="1.1 x the grid alone",
        ),
        Check(
            "plate, L2 of u among the atoms",
            ours.displacement_md,
            high=1.25 * grid.displacement_continuum,
            source="1.25 x the grid alone outside",
        ),
    ]
