"""Output, time limits and status of a guest.

Three pipes lead out of the emulator: the command's stdout, its stderr, and the control line.
"""

import os
import select
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vcan.child_process import ChildProcess
from vcan.guardian import Guardian
from vcan.run_request import RunnerError, RunRequest

POWER_OFF_S = 5.0  # from the status on the control line to the end of the emulator; 0.1 s is usual


@dataclass(frozen=True)
class Emulator:
    argv: list[str]
    environment: dict[str, str]
    boot_limit_s: float


# Writes what the guest needs into the run directory and says how to start it; the three
# descriptors are the emulator's ends of stdout, stderr and control.
Prepare = Callable[[RunRequest, Path, list[int]], Emulator]


class _Output:
    def __init__(self, fd: int, child: ChildProcess):
        self._fd = fd
        self._child = child

    def __call__(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            try:
                view = view[os.write(self._fd, view) :]
            except BlockingIOError:
                select.select([], [self._fd], [])
            except BrokenPipeError:
                self._child.caught = signal.SIGPIPE
                return


class _Control:
    def __init__(self) -> None:
        self._data = b""
        self.started_s: float | None = None

    def __call__(self, data: bytes) -> None:
        self._data += data
        if self.started_s is None and self.value(b"START") is not None:
            self.started_s = time.monotonic()

    def value(self, word: bytes) -> str | None:
        for line in self._data.splitlines():
            if line.startswith(word):
                return line[len(word) :].decode(errors="replace").strip()
        return None


def run(request: RunRequest, name: str, prepare: Prepare) -> int | None:
    """The command's exit status, None at the time limit."""
    run_dir = Path(tempfile.mkdtemp(prefix="vcanrun.")).resolve()
    guardian = Guardian(run_dir)
    try:
        (run_dir / "command.sh").write_text(request.shell_script(name))
        return _run(request, name, prepare, run_dir, guardian)
    finally:
        guardian.finish()


def _run(
    request: RunRequest, name: str, prepare: Prepare, run_dir: Path, guardian: Guardian
) -> int | None:
    pipes = [os.pipe() for _ in range(3)]
    guest_ends = [write_end for _, write_end in pipes]
    emulator = prepare(request, run_dir, guest_ends)
    log = run_dir / "kernel.log"
    with log.open("wb") as log_file:
        child = ChildProcess(
            emulator.argv,
            guardian,
            stdout=log_file,
            stderr=log_file,
            pass_fds=guest_ends,
            env=emulator.environment,
            cwd="/",
        )
    boot_end_s = time.monotonic() + emulator.boot_limit_s
    for fd in guest_ends:
        os.close(fd)
    control = _Control()
    receivers = [_Output(1, child), _Output(2, child), control]
    for (read_end, _), receive in zip(pipes, receivers, strict=True):
        child.on_data(read_end, receive)

    def deadline() -> float | None:
        if control.started_s is None:
            return boot_end_s
        return None if request.timeout_s is None else control.started_s + request.timeout_s

    ended = child.wait_until(
        lambda: child.open_inputs() == 0 or control.value(b"FAIL") is not None, deadline
    )
    status = control.value(b"EXIT ")
    child.end(POWER_OFF_S if status is not None and ended else 0.0)

    if child.caught:
        return 128 + child.caught
    if status is not None:
        return int(status)
    if control.started_s is not None and not ended:
        return None
    kernel_text = log.read_text(errors="replace").strip()
    if request.verbose:
        print(kernel_text, file=sys.stderr)
    raise RunnerError(_why_no_status(name, control, ended, emulator, kernel_text))


def _why_no_status(
    name: str, control: _Control, ended: bool, emulator: Emulator, kernel_text: str
) -> str:
    failure = control.value(b"FAIL")
    if failure is not None:
        return f"the {name} guest could not be set up: {failure}"
    if not ended:
        return f"the {name} kernel did not boot within {emulator.boot_limit_s:g} s"
    last_line = (kernel_text.splitlines() or ["it printed nothing"])[-1].strip()
    when = "before the command ended" if control.started_s else "before the command started"
    return f"the {name} kernel stopped {when} (--verbose shows its log; last line: {last_line})"
