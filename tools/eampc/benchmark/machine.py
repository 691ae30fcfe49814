"""What a figure was measured on: processor, compiler, packages."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

PACKAGES = ("eampc", "numpy", "daqp", "osqp", "piqp", "clarabel", "ppopt")


def machine() -> dict[str, Any]:
    """Processor, cores, system, compiler with its flags, and the versions of all that is timed."""
    from eampc import _core

    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.release()}",
        "compiler": _core.build_information()["compiler"],
        "flags": _core.build_information()["flags"],
        "path": _core.build_information()["path"],
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


def version(package: str) -> str | None:
    """Of an installed package; None if it is not there."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def machine_sentence(of: dict[str, Any]) -> str:
    """The same for a reader."""
    packages = ", ".join(f"{name} {number}" for name, number in of["versions"].items() if number)
    return (
        f"{of['processor']}, {of['cores']} cores, {of['system']}; {of['compiler']}, {of['flags']}, "
        f"{of['path']} path; Python {of['python']}, {packages}"
    )


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            name, _, value = line.partition(":")
            if name.strip() in ("model name", "Model"):
                return value.strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
