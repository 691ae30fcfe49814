"""The queue of a CAN interface made to hold frames back, and a witness of what leaves it.

vcan is loaded with echo=1 (tools/vcanrun --echo): nobody, the sender included, sees a frame before
it has left the queue, as on hardware.
"""

import contextlib
import os
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

# tools/driver-lane runs the same tests on a real driver's can0.
INTERFACE = os.environ.get("EAMPC_TEST_INTERFACE", "vcan0")
SO_PRIORITY = 12  # socket(7); Python has no name for it
# sch_prio's map sends sockets of priority 6 to the first band, others' frames to the second.
UNHINDERED = 6
_LINE = re.compile(r"^\((\d+\.\d+)\) \S+ ([0-9A-F]+)#([0-9A-F]*)$")


def tc(*words: str) -> None:
    subprocess.run(["tc", "qdisc", *words], check=True)


def ip_link(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)


@contextlib.contextmanager
def second_band(*kind: str) -> Iterator[None]:
    """Frames of priority 0 go through a qdisc of `kind`, those of UNHINDERED past it."""
    tc("add", "dev", INTERFACE, "root", "handle", "1:", "prio")
    try:
        tc("add", "dev", INTERFACE, "parent", "1:2", "handle", "20:", *kind)
        yield
    finally:
        # Gone already where the test deleted the interface.
        subprocess.run(["tc", "qdisc", "del", "dev", INTERFACE, "root"], capture_output=True)


def plug(action: str) -> None:
    """ "block" or "release_indefinite"."""
    tc("change", "dev", INTERFACE, "parent", "1:2", "handle", "20:", "plug", action)


class Witness:
    """candump -L of the interface."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def frames(self) -> list[tuple[float, int, bytes]]:
        """(time in s, id, data) of everything seen so far, a half line at the end left out."""
        hits = [_LINE.match(line) for line in self.path.read_text().splitlines()]
        return [(float(hit[1]), int(hit[2], 16), bytes.fromhex(hit[3])) for hit in hits if hit]

    def commands(self) -> list[bytes]:
        """Data of the valve commands."""
        return [data for _, name, data in self.frames() if name == 0x201]


@contextlib.contextmanager
def witness(path: Path) -> Iterator[Witness]:
    with path.open("wb") as log:
        dump = subprocess.Popen(["candump", "-L", "-r", "4000000", INTERFACE], stdout=log)
        seen = Witness(path)
        try:
            limit = time.monotonic() + 60.0
            while not seen.frames():  # a frame of our own proves that it listens
                assert time.monotonic() < limit, "candump hears nothing"
                subprocess.run(["cansend", INTERFACE, "7FF#00"], check=True)
                time.sleep(0.1)
            yield seen
            time.sleep(0.3)
        finally:
            dump.terminate()
            dump.wait(30.0)
