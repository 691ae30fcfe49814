"""Start, wait for and end the one child of the runner.

The child leads a session and process group of its own and dies with the runner (PDEATHSIG);
SIGINT, SIGTERM, SIGHUP and time limits end the wait; end() leaves none of its processes.
"""

import contextlib
import ctypes
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from vcan.guardian import Guardian

PR_SET_PDEATHSIG = 1  # linux/prctl.h
PR_SET_CHILD_SUBREAPER = 36
_libc = ctypes.CDLL(None)  # before the fork: nothing may be loaded between fork and exec


def _die_with_parent() -> None:
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


class ChildProcess:
    def __init__(self, argv: list[str], guardian: Guardian, **popen):
        self.caught: int | None = None
        # Where there is no PID namespace, daemons of the child come to the runner: see end().
        _libc.prctl(PR_SET_CHILD_SUBREAPER, 1)
        self._wake_read, wake_write = os.pipe()
        os.set_blocking(wake_write, False)
        signal.set_wakeup_fd(wake_write)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD):
            signal.signal(number, self._note)
        self._process = subprocess.Popen(
            argv,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_die_with_parent,
            **popen,
        )
        guardian.watch(self._process.pid)
        self._guardian_pid = guardian.pid
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)

    def _note(self, number: int, _frame: object) -> None:
        if number != signal.SIGCHLD:
            self.caught = self.caught or number

    def on_data(self, fd: int, receive: Callable[[bytes], None]) -> None:
        self._selector.register(fd, selectors.EVENT_READ, receive)

    def open_inputs(self) -> int:
        return len(self._selector.get_map()) - 1

    def poll(self) -> int | None:
        return self._process.poll()

    def wait_until(self, done: Callable[[], bool], deadline: Callable[[], float | None]) -> bool:
        """True when done; False on a signal (then `caught` is set) or at the deadline."""
        while not done():
            end_s = deadline()
            now_s = time.monotonic()
            if self.caught or (end_s is not None and now_s >= end_s):
                return False
            for key, _ in self._selector.select(None if end_s is None else end_s - now_s):
                data = os.read(key.fd, 65536)
                if key.data is None:
                    continue
                if data:
                    key.data(data)
                else:
                    self._selector.unregister(key.fd)
        return True

    def end(self, grace_s: float = 0.0) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(grace_s)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        while orphans := _children() - {self._guardian_pid}:
            for pid in orphans:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)


def _children() -> set[int]:
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            # proc(5): pid (name) state ppid; the name may hold anything, brackets too.
            _, ppid = stat.read_text(errors="replace").rpartition(")")[2].split()[:2]
            if int(ppid) == os.getpid():
                found.add(int(stat.parent.name))
    return found
