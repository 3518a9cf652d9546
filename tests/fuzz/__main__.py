"""Feed the decoders with inputs that find new ways through them: ``python -m tests.fuzz``.

    python -m tests.fuzz [--inputs NUMBER] [--corpus FOLDER]

An input is the part of a frame behind its checksum; the harness adds a checksum that is right,
which no fuzzer would guess. A decoder may refuse an input with `ProtocolError`. Anything else, a
read outside the frame included, ends the fuzzer with the input that caused it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import zlib
from pathlib import Path
from typing import get_args

import atheris
import numpy as np

with atheris.instrument_imports(include=["gimpmd_schemas", "gimpmd_coupler"]):
    from gimpmd_coupler.mapping import check_ids, links
    from gimpmd_schemas.errors import ProtocolError
    from gimpmd_schemas.wire.messages import (
        MAGIC,
        Grant,
        Message,
        Payload,
        Register,
        Report,
        StepReport,
        decode,
        encode,
    )

ALL = get_args(Message)
LONGEST = 4096
"""Bytes of an input at most."""


def seeds() -> list[bytes]:
    """Frames that are right, without magic bytes and checksum."""
    ids = np.arange(5)
    register = Register(
        protocol=4, run="a", plan="b", role="md", rank=0, ranks=1, backend="c", units="lj",
        dt=0.1, patch=((0.0, 1.0), (0.0, 1.0)), host="h", pid=1,
    )  # fmt: skip
    step = StepReport(step=1, energies=None, timings={"wait": 0.1})
    frames = [
        encode(register, {"offers": ids, "needs": ids}),
        encode(Report(role="md", rank=0, steps=(step,), peak_memory=1)),
        encode(Grant(granted=2, last=9, done=0)),
        encode(Payload(role="continuum", rank=1, step=3), {"velocity": np.ones((4, 2))}),
        encode(Payload(role="md", rank=1, step=3), {"none": np.zeros((0, 2), dtype="<f4")}),
    ]
    return [frame[8:] for frame in frames]


def feed(data: bytes) -> None:
    """Decode one input, and do with the result what the coupler and the ranks do."""
    try:
        message, arrays = decode(MAGIC + zlib.crc32(data).to_bytes(4, "little") + data, ALL)
        for array in arrays.values():
            array.tobytes()  # reads all of it
        if isinstance(message, Register):
            offers = check_ids("md/0", "offers", arrays.get("offers"))
            needs = check_ids("md/0", "needs", arrays.get("needs"))
            links("md/0", needs, {0: offers}, "continuum")
    except ProtocolError:
        pass


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000_000)
    parser.add_argument("--corpus", type=Path, help="folder of inputs found before; new ones added")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as first:
        for k, seed in enumerate(seeds()):
            (Path(first) / f"seed{k}").write_bytes(seed)
        folders = [str(options.corpus)] if options.corpus else []
        words = [f"-runs={options.inputs}", f"-max_len={LONGEST}", "-seed=1", *folders, first]
        atheris.Setup([sys.argv[0], *words], feed)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
