"""Removes what a killed runner leaves behind.

A forked process in a session of its own holds the read end of a pipe whose write end only the
runner has: end of file means that the runner is gone, for whatever reason, SIGKILL included.
It then kills the child's process group, undoes changes to the host and deletes the run directory.
"""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

KILL_ROUNDS = 3  # a process forked during the first round is caught by the next
KILL_PAUSE_S = 0.05


class Guardian:
    def __init__(self, run_dir: Path, undo: list[list[str]] | None = None):
        read_end, self._write_end = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                os.close(self._write_end)
                _detach(read_end)
                _clean_up(_read_process_group(read_end), run_dir, undo or [])
            finally:
                os._exit(0)
        os.close(read_end)

    def watch(self, process_group: int) -> None:
        os.write(self._write_end, b"%d" % process_group)

    def finish(self) -> None:
        """Let it clean up and wait until it has."""
        os.close(self._write_end)
        os.waitpid(self.pid, 0)


def _detach(keep_fd: int) -> None:
    os.setsid()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    null = os.open(os.devnull, os.O_RDWR)
    for standard_fd in (0, 1, 2):
        os.dup2(null, standard_fd)
    # Somebody may be waiting for the end of file on a descriptor that was inherited.
    os.closerange(3, keep_fd)
    os.closerange(keep_fd + 1, os.sysconf("SC_OPEN_MAX"))
    os.chdir("/")


def _read_process_group(read_end: int) -> int | None:
    data = b""
    while chunk := os.read(read_end, 64):
        data += chunk
    return int(data) if data else None


def _clean_up(process_group: int | None, run_dir: Path, undo: list[list[str]]) -> None:
    if process_group is not None:
        for _ in range(KILL_ROUNDS):
            try:
                os.killpg(process_group, signal.SIGKILL)
            except ProcessLookupError:
                break
            time.sleep(KILL_PAUSE_S)
    for argv in undo:
        subprocess.call(argv)
    shutil.rmtree(run_dir, ignore_errors=True)
