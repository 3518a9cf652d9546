"""A network link in user space, which can be made slow and lossy: ``link.py NEAR FAR CONDITIONS``.

It makes two TAP devices and hands frames on from each to the other. The file CONDITIONS holds two
numbers: the delay of a frame (seconds) and the share of frames that are lost. It is read again all
the time. ``tc netem`` does the same on kernels that have it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque
from pathlib import Path

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
LARGEST_FRAME = 65536
LOOK_SECONDS = 0.1


def tap(name: str) -> int:
    """Make a TAP device; it exists as long as its file is open."""
    file = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(file, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    return file


def hand_on(ends: tuple[int, int], conditions: Path) -> None:
    """Hand frames on for ever."""
    other = {ends[0]: ends[1], ends[1]: ends[0]}
    waiting: deque[tuple[float, int, bytes]] = deque()
    delay, loss, looked, chance = 0.0, 0.0, 0.0, random.Random(1)
    while True:
        now = time.monotonic()
        if now - looked > LOOK_SECONDS:
            looked = now
            delay, loss = map(float, conditions.read_text().split())
        while waiting and waiting[0][0] <= now:
            _, end, frame = waiting.popleft()
            with contextlib.suppress(OSError):  # the device is not up yet: the frame is lost
                os.write(end, frame)
        patience = min(waiting[0][0] - now, LOOK_SECONDS) if waiting else LOOK_SECONDS
        for end in select.select(ends, [], [], max(patience, 0.0))[0]:
            frame = os.read(end, LARGEST_FRAME)
            if chance.random() >= loss:
                waiting.append((time.monotonic() + delay, other[end], frame))


if __name__ == "__main__":
    near, far, conditions = sys.argv[1:]
    ends = tap(near), tap(far)
    print("ready", flush=True)
    hand_on(ends, Path(conditions))
