"""The daemon's process, for the one fault that is its own: deadlines missed because it was stopped.

A stop is no instant thing: the kernel lets an ordinary thread take the signal, which on a loaded
machine waits its turn while the real-time thread goes on.
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from plant_emulator.emulator_error import EmulatorError

_STOP_LIMIT_S = 1.0
_POLL_S = 0.0002


class DaemonProcess:
    """One process by its id; raises EmulatorError if it is not there or not ours."""

    def __init__(self, pid: int) -> None:
        self._pid = pid

    def stop(self) -> None:
        """Return when every thread of it stands."""
        self._signal(signal.SIGSTOP)
        limit = time.monotonic() + _STOP_LIMIT_S
        while not self._stands():
            if time.monotonic() > limit:
                self._signal(signal.SIGCONT)
                raise EmulatorError(f"the daemon (process {self._pid}) does not stop")
            time.sleep(_POLL_S)

    def go_on(self) -> None:
        """Let it run again."""
        self._signal(signal.SIGCONT)

    def _stands(self) -> bool:
        try:
            stats = [path.read_text() for path in Path(f"/proc/{self._pid}/task").glob("*/stat")]
        except OSError:
            return False
        return all(stat.rpartition(")")[2].split()[0] == "T" for stat in stats)

    def _signal(self, number: signal.Signals) -> None:
        try:
            os.kill(self._pid, number)
        except OSError as error:
            raise EmulatorError(
                f"the daemon (process {self._pid}) cannot be stopped: {error.strerror}"
            ) from None
