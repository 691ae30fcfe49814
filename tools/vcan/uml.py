"""User-mode Linux: a kernel that is an ordinary process, with the host's files as its root.

Boots in about 3 s, needs no root and no virtualisation; a system call costs about 100 us, so it
suits functional tests and no latency figures.
"""

import os
import re
import subprocess
from pathlib import Path

from vcan import guest_init, kernel_modules
from vcan.guest_session import Emulator
from vcan.run_request import BackendMissing, RunRequest, program

NAME = "uml"
BOOT_LIMIT_S = 120.0  # 3 s alone on two cores; forty times that for a machine under load


def check() -> str:
    """The kernel's path; raises when something is missing."""
    kernel = program("linux.uml", "user-mode-linux")
    program("busybox", "busybox-static")
    if not _module_tree(kernel):
        raise BackendMissing("the modules of user-mode Linux are not in /usr/lib/uml/modules")
    return kernel


def _module_tree(kernel: str) -> Path | None:
    trees = Path(kernel).resolve().parent.parent.glob("lib/uml/modules/*")
    return max(trees, default=None)


def prepare(request: RunRequest, run_dir: Path, fds: list[int]) -> Emulator:
    kernel = check()
    modules = kernel_modules.in_load_order(_module_tree(kernel), ["overlay", *kernel_modules.CAN])
    (run_dir / "modules").mkdir()
    (run_dir / "mount").mkdir()
    for name, data in modules.items():
        (run_dir / "modules" / f"{name}.ko").write_bytes(data)
    init = run_dir / "init"
    busybox = program("busybox", "busybox-static")
    init.write_text(
        guest_init.for_uml(busybox, run_dir, request.buses, list(modules), request.writable)
    )
    init.chmod(0o755)
    out, err, control = fds
    argv = [
        *_pid_namespace(),
        kernel,
        f"mem={request.memory}",
        *("rootfstype=hostfs", "rootflags=/", "ro", f"init={init}"),
        *(f"uml_dir={run_dir}", "umid=guest"),
        *("con=null", "con0=null,fd:1", "ssl=null"),
        *(f"ssl0=null,fd:{out}", f"ssl1=null,fd:{err}", f"ssl2=null,fd:{control}"),
        *("quiet", "panic=-1"),
    ]
    environment = {**os.environ, "TMPDIR": _memory_dir(request.memory)}
    return Emulator(argv, environment, BOOT_LIMIT_S)


def _pid_namespace() -> list[str]:
    """In a PID namespace the kernel's helper processes cannot outlive it."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-current-user"]
    unshare = [program("unshare", "util-linux"), *user, "--pid", "--fork", "--kill-child=SIGKILL"]
    allowed = subprocess.call([*unshare, "true"], stderr=subprocess.DEVNULL) == 0
    return unshare if allowed else []


def _memory_dir(memory: str) -> str:
    """The guest's memory is a file that is executed from; containers often have a /dev/shm that
    is mounted noexec or holds 64 MB."""
    number, unit = re.fullmatch(r"(\d+)([MG])", memory).groups()
    needed = int(number) << {"M": 20, "G": 30}[unit]
    shm = os.statvfs("/dev/shm") if os.path.isdir("/dev/shm") else None
    if shm and not shm.f_flag & os.ST_NOEXEC and shm.f_bavail * shm.f_frsize >= needed:
        return "/dev/shm"
    return os.environ.get("TMPDIR", "/tmp")
