"""Start a service behind a relay that breaks its connections now and then.

    python -m tests.foreign.cutting PROGRAM WORDS ...

Ends with the exit code of the program.
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.relay import Proxy


def main(words: list[str]) -> int:
    """Run the program with the relay in place of the endpoint."""
    place = words.index("--connect") + 1
    random_ = random.Random(7)
    with tempfile.TemporaryDirectory() as folder:
        relay = Proxy(words[place], Path(folder))
        words[place] = relay.endpoint
        with subprocess.Popen(words) as program:
            while program.poll() is None:
                time.sleep(random_.uniform(0.1, 0.5))
                relay.cut()
        relay.close()
    print(f"connections were cut {relay.cuts} times", file=sys.stderr)
    return program.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
