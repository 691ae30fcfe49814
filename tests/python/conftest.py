"""What several tests need: the command line as a program, and laws that are designed only once."""

import os
import subprocess
import sys
from collections.abc import Callable

import pytest
from ready_rigs import LAWS, ROOT

Eampc = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def eampc_environment() -> dict[str, str]:
    """Laws are kept in the build folder: one design serves all tests, those on vcan0 too."""
    return {
        **os.environ,
        "XDG_CACHE_HOME": str(LAWS),
        "COLUMNS": "100",
        "NO_COLOR": "1",
    }


@pytest.fixture(scope="session")
def eampc(eampc_environment: dict[str, str]) -> Eampc:
    """Runs `eampc ARGUMENT ...` from the repository's root, as a user would."""

    def run(*arguments: object, timeout_s: float = 250.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "eampc.command_line", *map(str, arguments)],
            cwd=ROOT,
            env=eampc_environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
        )

    return run
