"""The programs of a run: started with their output in a file, watched, and gone afterwards whatever
happens.

Each child leads its own process group, so that Ctrl-C reaches this program only, and has SIGTERM as
parent-death signal, so that a killed `eampc hil` leaves nothing behind either.
"""

import contextlib
import ctypes
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from eampc.errors import RunFailed, UserError

PR_SET_PDEATHSIG = 1  # prctl(2)
# Orderly ends take a soft-stop ramp (0.5 s on the reference rig) at most; a slow machine gets ten
# times that.
STOP_GRACE_S = 5.0
# A daemon checks a law of 2 MB and locks its memory; user-mode Linux needs some 10 s for that.
READY_LIMIT_S = 60.0
POLL_S = 0.05

_libc = ctypes.CDLL(None, use_errno=True)


def _die_with_parent() -> None:
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


class Process:
    """One child. name: as messages call it; log: file that takes its stdout and stderr."""

    def __init__(
        self, name: str, command: Sequence[str], log: Path, pass_fds: Sequence[int] = ()
    ) -> None:
        self.name = name
        self.log = log
        with open(log, "wb") as output:
            try:
                self._popen = subprocess.Popen(
                    [os.fspath(word) for word in command],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    pass_fds=tuple(pass_fds),
                    process_group=0,
                    preexec_fn=_die_with_parent,
                )
            except OSError as error:
                raise UserError(f"cannot start {command[0]}: {error.strerror}") from None

    @property
    def pid(self) -> int:
        return self._popen.pid

    def running(self) -> bool:
        return self._popen.poll() is None

    def exit_code(self) -> int | None:
        return self._popen.poll()

    def last_words(self) -> str:
        """Its last line of output that it addressed to the user (prefix "name: "), else its last
        line.
        """
        with contextlib.suppress(OSError):
            lines = [
                line.strip()
                for line in self.log.read_text(encoding="utf-8", errors="replace").splitlines()
                if line.strip()
            ]
            own = [line for line in lines if line.startswith(f"{self.name}: ")]
            if own:
                return own[-1]
            if lines:
                return f"{self.name}: {lines[-1]}"
        return f"{self.name}: no output"

    def failure(self) -> UserError:
        """Why it ended: its own sentence; bad input (its exit code 2) stays bad input."""
        code = self.exit_code()
        if code == 2:
            return UserError(self.last_words())
        how = (
            f"was ended by signal {-code}" if code is not None and code < 0 else f"failed ({code})"
        )
        return RunFailed(f"{self.name} {how}; {self.last_words()} (whole output: {self.log})")

    def wait(self, limit_s: float) -> bool:
        """True if it has ended within the limit."""
        try:
            self._popen.wait(limit_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def stop(self, grace_s: float = STOP_GRACE_S) -> None:
        """SIGTERM, and SIGKILL to its whole group if that is not heeded in time."""
        if self.running():
            self._popen.terminate()
            if not self.wait(grace_s):
                self.kill()

    def kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._popen.wait()

    def peak_memory_MB(self) -> float | None:
        """Largest resident set so far (VmHWM), in 10⁶ bytes; None once it has ended."""
        with contextlib.suppress(OSError, ValueError, IndexError):
            for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
                if line.startswith("VmHWM:"):
                    return int(line.split()[1]) * 1024 / 1e6
        return None


class Ensemble:
    """The programs of one run. On leaving the context the daemon is stopped first: it can only ramp
    the valves down while the emulator still feeds it encoder frames."""

    def __init__(self) -> None:
        self._processes: list[Process] = []

    def __enter__(self) -> "Ensemble":
        return self

    def __exit__(self, *_: object) -> None:
        with held_back_signals():
            for process in self._processes:
                process.stop()

    def start(self, process: Process) -> Process:
        self._processes.append(process)
        return process

    def start_daemon(self, command: Sequence[str], log: Path) -> Process:
        """Starts eampcd and returns when its bus and socket are up (--ready-fd)."""
        read_end, write_end = os.pipe()
        try:
            daemon = self.start(
                Process("eampcd", [*command, "--ready-fd", str(write_end)], log, [write_end])
            )
        finally:
            os.close(write_end)
        try:
            _await_ready(daemon, read_end)
        finally:
            os.close(read_end)
        return daemon

    def supervise(self, awaited: Process, limit_s: float) -> Iterator[None]:
        """Yields every POLL_S until `awaited` ends well; any process that fails or hangs ends the
        run.
        """
        deadline = time.monotonic() + limit_s
        while not awaited.wait(POLL_S):
            for process in self._processes:
                if process is not awaited and not process.running():
                    raise process.failure()
            if time.monotonic() > deadline:
                raise RunFailed(
                    f"{awaited.name} did not end within {limit_s:.0f} s; {awaited.last_words()}"
                )
            yield
        if awaited.exit_code() != 0:
            # The emulator's complaint that nobody answers is a symptom if the daemon died just
            # before.
            for process in self._processes:
                if process is not awaited and not process.running():
                    raise process.failure()
            raise awaited.failure()


def _await_ready(daemon: Process, read_end: int) -> None:
    deadline = time.monotonic() + READY_LIMIT_S
    seen = b""
    while b"\n" not in seen:
        if select.select([read_end], [], [], POLL_S)[0]:
            part = os.read(read_end, 64)
            seen += part
            if not part:
                daemon.wait(STOP_GRACE_S)
                raise daemon.failure()
        elif time.monotonic() > deadline:
            raise RunFailed(
                f"eampcd was not ready within {READY_LIMIT_S:.0f} s; {daemon.last_words()}"
            )


@contextlib.contextmanager
def held_back_signals() -> Iterator[None]:
    """A second Ctrl-C must not interrupt the clean-up that the first one started."""
    signals = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


@contextlib.contextmanager
def ended_by_signal() -> Iterator[None]:
    """SIGTERM and SIGHUP unwind like Ctrl-C, so that the clean-up runs."""

    def unwind(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    previous = {number: signal.signal(number, unwind) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def daemon_program() -> str:
    """eampcd of the same environment as this Python, else of PATH."""
    beside = Path(sys.executable).parent / "eampcd"
    if beside.is_file() and os.access(beside, os.X_OK):
        return str(beside)
    if found := shutil.which("eampcd"):
        return found
    raise UserError(
        f"eampcd is neither in {beside.parent} nor in PATH; run tools/setup, or pip install ."
    )


def emulator_command() -> list[str]:
    return [sys.executable, "-m", "plant_emulator"]


def raise_priority(process: Process, priority: int) -> bool:
    """SCHED_FIFO for a stand-in of hardware that would never be late; False where that is not
    allowed.
    """
    try:
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    return True
