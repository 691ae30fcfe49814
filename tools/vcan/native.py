"""This kernel: vcan in network and PID namespaces of the command's own, else on the host.

Namespaces first, also where vcan0 exists already: no foreign traffic on the bus, the same empty
network as in a guest, and nothing to clean up. Where a container forbids them the host's vcan0
is used, and made for the time of the run if the kernel lets us.
"""

import os
import re
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from vcan.child_process import ChildProcess
from vcan.guardian import Guardian
from vcan.run_request import BackendMissing, RunRequest, program

NAME = "native"

# $1 ip, $2 number of buses, then the command; the shell stays as process 1 of the namespace,
# because process 1 would ignore every signal that it does not handle.
_NAMESPACE_SCRIPT = """
ip=$1; buses=$2; shift 2
"$ip" link set lo up multicast on || exit 125
"$ip" route add 224.0.0.0/4 dev lo || exit 125
i=0
while [ $i -lt $buses ]; do
  "$ip" link add dev vcan$i type vcan || exit 125
  "$ip" link set vcan$i mtu 72 up || exit 125
  i=$((i + 1))
done
"$@"
exit $?
"""


@dataclass(frozen=True)
class Place:
    reason: str
    prefix: list[str]
    undo: list[list[str]]


def _echoes() -> bool:
    parameter = Path("/sys/module/vcan/parameters/echo")
    return parameter.exists() and parameter.read_text().strip() == "Y"


def find_place(request: RunRequest) -> Place:
    if request.echo and not _echoes():
        raise BackendMissing("this kernel's vcan is not loaded with echo=1")
    ip = program("ip", "iproute2")
    unshare = program("unshare", "util-linux")
    user = [] if os.geteuid() == 0 else ["--user", "--map-current-user", "--keep-caps"]
    refusal = ""
    for options in (["--mount-proc"], []):
        namespaces = [unshare, *user, "--net", "--pid", "--fork", "--kill-child=SIGKILL", *options]
        prefix = [*namespaces, "/bin/sh", "-c", _NAMESPACE_SCRIPT, "sh", ip, str(request.buses)]
        trial = _try([*prefix, "true"])
        if trial is None:
            return Place("vcan works in a network namespace of its own", prefix, [])
        refusal = trial
    return _host_place(ip, request.buses, refusal)


def _host_place(ip: str, buses: int, refusal: str) -> Place:
    undo: list[list[str]] = []
    for name in (f"vcan{i}" for i in range(buses)):
        if not Path("/sys/class/net", name).exists():
            refused = _try([ip, "link", "add", "dev", name, "type", "vcan"])
            if refused is not None:
                _undo(undo)
                reasons = "; ".join(dict.fromkeys([refused, refusal]))
                raise BackendMissing(f"this kernel gives no vcan ({reasons})")
            undo.append([ip, "link", "delete", name])
        refused = None if _is_up(ip, name) else _try([ip, "link", "set", name, "mtu", "72", "up"])
        if refused is not None:
            _undo(undo)
            raise BackendMissing(f"{name} is down and may not be set up here ({refused})")
    return Place("vcan works on the host and namespaces are refused", [], undo)


def _undo(commands: list[list[str]]) -> None:
    for argv in commands:
        subprocess.call(argv)


def _is_up(ip: str, name: str) -> bool:
    shown = subprocess.run([ip, "-o", "link", "show", name], capture_output=True, text=True)
    return "UP" in re.findall(r"\w+", shown.stdout.partition(">")[0])


def _try(argv: list[str]) -> str | None:
    """None when it worked, else the last line it said."""
    done = subprocess.run(argv, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode == 0:
        return None
    last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
    return last.removeprefix("Error: ").rstrip(".")


def run(request: RunRequest, place: Place) -> int | None:
    """The command's exit status, None at the time limit."""
    run_dir = Path(tempfile.mkdtemp(prefix="vcanrun."))
    guardian = Guardian(run_dir, place.undo)
    script = run_dir / "command.sh"
    script.write_text(request.shell_script(NAME))
    try:
        started_s = time.monotonic()
        child = ChildProcess([*place.prefix, "/bin/sh", str(script)], guardian)
        limit_s = None if request.timeout_s is None else started_s + request.timeout_s
        child.wait_until(lambda: child.poll() is not None, lambda: limit_s)
        status = child.poll()
        child.end()
    finally:
        guardian.finish()
    if child.caught:
        return 128 + child.caught
    if status is None:
        return None
    return 128 - status if status < 0 else status
