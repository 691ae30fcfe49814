"""A joint for tests of the bus: an encoder frame per period from a thread, past every queue."""

import socket
import sys
import threading
from pathlib import Path

import can

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
from interface_queue import INTERFACE, SO_PRIORITY, UNHINDERED
from toy_daemon import EncoderNode

# linux/can/error.h: classes of error frames.
BUS_OFF, RESTARTED, CONTROLLER, NO_ACK = 0x40, 0x100, 0x04, 0x20
PERIOD_S = 0.02  # user-mode Linux keeps this pace


class JointThread:
    """Rests at 0 rad. Use as a context manager."""

    def __init__(self) -> None:
        self._bus = can.Bus(interface="socketcan", channel=INTERFACE, can_filters=[])
        self._bus.socket.setsockopt(socket.SOL_SOCKET, SO_PRIORITY, UNHINDERED)
        self._node = EncoderNode()
        self.refused = 0  # an encoder goes on whether the bus takes its frames or not
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            try:
                self._bus.send(self._node.frame())
            except (can.CanError, OSError):
                self.refused += 1

    def send_error_frame(self, kind: int, data: bytes = bytes(8)) -> None:
        """Forge what a controller's driver would report."""
        self.send(can.Message(arbitration_id=kind, is_error_frame=True, dlc=8, data=data))

    def send(self, message: can.Message) -> None:
        """Send from the same place."""
        self._bus.send(message)

    def __enter__(self) -> "JointThread":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()
