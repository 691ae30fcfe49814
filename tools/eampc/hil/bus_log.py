"""Everything that was said on the bus, in the format of `candump -L`."""

import threading
from pathlib import Path
from types import TracebackType
from typing import Self

import can
from eampc_rig import open_bus

from eampc.user_error import UserError

POLL_S = 0.1


class BusLog:
    """Listens from construction to the end of the context; sends nothing."""

    def __init__(self, url: str, path: Path) -> None:
        self.frames = 0
        self._bus = open_bus(url)
        self._stop = threading.Event()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = can.CanutilsLogWriter(path, channel=url.partition(":")[2].split(":")[0])
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
            message.channel = None  # the writer's own name, not the transport's address tuple
            self._writer.on_message_received(message)

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
        self._writer.stop()
        self._bus.shutdown()
