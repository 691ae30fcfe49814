"""What is to be run, and the one error every backend raises."""

import os
import shlex
import shutil
from dataclasses import dataclass, field
from pathlib import Path

# Non-root users of Debian have no sbin directories in PATH, but `ip` and `insmod` live there.
SEARCH_PATH = os.environ.get("PATH", os.defpath) + ":/usr/sbin:/sbin"


class RunnerError(Exception):
    """The command could not be started; the text is one sentence with what to do about it."""


class BackendMissing(RunnerError):
    """This machine lacks something the backend needs; another backend may still do."""


@dataclass(frozen=True)
class RunRequest:
    command: list[str]
    buses: int
    timeout_s: float | None
    memory: str
    writable: list[Path]
    verbose: bool
    controllers: int = 0  # emulated hardware, can0 .. on one bus
    echo: bool = False  # a vcan that echoes a frame when it leaves the queue
    cwd: Path = field(default_factory=lambda: Path.cwd().resolve())

    def environment(self, backend: str) -> dict[str, str]:
        return {**os.environ, "VCANRUN_BACKEND": backend}

    def shell_script(self, backend: str) -> str:
        """The command for /bin/sh: every argument and variable intact, whatever it contains."""
        env = [f"{name}={value}" for name, value in self.environment(backend).items()]
        return (
            f"cd {shlex.quote(str(self.cwd))} || exit 125\n"
            f"exec /usr/bin/env -i {shlex.join(env)} {shlex.join(self.command)}\n"
        )


def program(name: str, package: str) -> str:
    path = shutil.which(name, path=SEARCH_PATH)
    if path is None:
        raise BackendMissing(f"{name} is not installed (apt-get install {package})")
    return path
