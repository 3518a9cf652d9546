"""A uniform strain of the size of real loads, in atoms and continuum of copper in space.

The table gives the largest departure of the strain of a material point after .64 ps, and the
median, over the size of the strain: what the continuum's law leaves out drives the two sides apart.

    python -m tests.physics.interface.finite_strain [--metal COPPER] [--sizes 1e-5 5e-3 1e-2]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from tests import copper_sites
from tests.copper_sites import copper_case, strained
from tests.physics.test_sites_in_space import BODIES, run_case, strain_errors

MODELS = ("linear", "cauchy-born", "lattice-sum")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Uniform strain held with each law.")
    parser.add_argument("--metal", default="COPPER")
    parser.add_argument("--sizes", type=float, nargs="+", default=[1e-5, 5e-3, 1e-2])
    options = parser.parse_args()
    metal = getattr(copper_sites, options.metal)
    print("body     strain  law            largest   median")
    for body in ("slab", "column"):
        for size in options.sizes:
            for model in MODELS:
                case = strained(copper_case(*BODIES[body], 0.64, metal), size)
                case["continuum"]["material"]["model"] = model
                with tempfile.TemporaryDirectory() as folder:
                    off = strain_errors(run_case(case, Path(folder), metal)) / size
                print(
                    f"{body:8} {size:6g}  {model:12} {off.max():9.1e} {np.median(off):8.1e}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
