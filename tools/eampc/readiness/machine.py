"""This machine and this user: may eampcd have what real time needs, is somebody running it?"""

from __future__ import annotations

import os
import resource
import subprocess
import threading
from pathlib import Path

from eampc.errors import UserError
from eampc.operator_client import OperatorClient
from eampc.readiness.finding import Finding, judged

PRIORITY = 70  # eampcd's default
# Law, libraries and stacks of a daemon with a large law: 60 MB; with room for tables.
LOCKED_BYTES = 128 << 20
CAP_IPC_LOCK = 14
LCM_GROUP = "239.255.76.67"


def look_at_machine(socket_path: Path | None) -> list[Finding]:
    return [_scheduling(), _memory(), _kernel(), _route(), _daemon(socket_path)]


def _scheduling() -> Finding:
    """Asked for in a thread of its own that ends at once: nothing keeps the policy."""
    refused: list[OSError] = []

    def ask() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError as error:
            refused.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    return judged(
        "real-time policy",
        not refused,
        f"SCHED_FIFO priority {PRIORITY} is "
        + (f"refused ({refused[0].strerror})" if refused else "granted"),
        "run eampcd by its systemd unit (deploy/), or: a line `@eampc - rtprio 80` in "
        "/etc/security/limits.conf and a new login",
    )


def _memory() -> Finding:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    effective = next(line for line in status.splitlines() if line.startswith("CapEff:"))
    hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    any_size = hard == resource.RLIM_INFINITY or int(effective.split()[1], 16) >> CAP_IPC_LOCK & 1
    return judged(
        "locked memory",
        bool(any_size) or hard >= LOCKED_BYTES,
        "any size" if any_size else f"up to {hard >> 20} MB",
        f"run eampcd by its systemd unit, or: `@eampc - memlock {LOCKED_BYTES >> 10}` in "
        "/etc/security/limits.conf and a new login",
    )


def _kernel() -> Finding:
    realtime = Path("/sys/kernel/realtime")
    preempt_rt = realtime.exists() and realtime.read_text().strip() == "1"
    return Finding(
        "kernel",
        f"{os.uname().release}, "
        + ("PREEMPT_RT" if preempt_rt else "not PREEMPT_RT: latencies of milliseconds under load"),
    )


def _route() -> Finding:
    try:
        told = subprocess.run(
            ["ip", "route", "get", LCM_GROUP], capture_output=True, text=True, timeout=10
        )
    except (OSError, subprocess.SubprocessError):
        return Finding("telemetry route", "unknown, there is no ip command")
    device = told.stdout.split(" dev ")[-1].split()[0] if " dev " in told.stdout else ""
    return judged(
        "telemetry route",
        bool(device),
        f"LCM's group is on {device}" if device else "LCM's group has none",
        f"ip route add {LCM_GROUP}/32 dev lo, or the unit lcm-route.service",
    )


def _daemon(socket_path: Path | None) -> Finding:
    try:
        with OperatorClient(socket_path, timeout_s=2.0) as client:
            status = client.status()
    except UserError as error:
        return Finding("daemon", f"none answers: {error}")
    except Exception as error:  # a daemon of another version still is a daemon
        return Finding("daemon", f"it answers, but not as expected: {error}")
    fault = status.get("fault_number", 0)
    return judged(
        "daemon",
        fault == 0,
        f"{status.get('mode')}, {status.get('realtime_text')}"
        + (f", fault: {status.get('fault')}" if fault else ""),
        "mend the cause, then `eampc reset`",
    )
