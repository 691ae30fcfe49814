"""Everything that was said on the bus, in the format of `candump -L`."""

import os
import socket
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

import can
from eampc_rig import open_bus

from eampc.errors import UserError

POLL_S = 0.1
SO_RCVBUFFORCE = 33  # socket(7); Python has no name for it
# The kernel charges some 800 bytes per frame: room for about 10,000, three scenarios' worth.
RECEIVE_BUFFER_BYTES = 8_000_000


class BusLog:
    """Listens from construction to the end of the context; sends nothing."""

    def __init__(self, url: str, path: Path) -> None:
        self.frames = 0
        self._bus = open_bus(url)
        _enlarge_receive_buffer(self._bus.fileno())
        self._name = url.partition(":")[2].split(":")[0]
        self._stop = threading.Event()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(path, "w", encoding="ascii")  # noqa: SIM115
        except OSError as error:
            self._bus.shutdown()
            raise UserError(f"--candump {path}: cannot be written: {error.strerror}") from None
        self._thread = threading.Thread(target=self._listen, name="bus-log", daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while True:
            message = self._bus.recv(POLL_S)
            if message is None:
                if self._stop.is_set():
                    return
                continue
            self.frames += 1
            self._file.write(_line(message, self._name))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        self._file.close()
        self._bus.shutdown()


def _enlarge_receive_buffer(descriptor: int) -> None:
    # In lock-step both others are faster than this listener; as root beyond net.core.rmem_max.
    with socket.socket(fileno=os.dup(descriptor)) as shared:
        try:
            shared.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
        except OSError:
            shared.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


def _line(message: can.Message, name: str) -> str:
    # Not python-can's writer: since 4.3 it appends a direction that candump -L does not have.
    digits = 8 if message.is_extended_id else 3
    data = "R" if message.is_remote_frame else bytes(message.data).hex().upper()
    return f"({message.timestamp:.6f}) {name} {message.arbitration_id:0{digits}X}#{data}\n"
