"""deploy/: the unit's exposure, and the daemon as the unit runs it: no root, no capability, the
unit's own limits, readiness and watchdog as systemd hears them. The test is the service manager."""

import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from toy_daemon import UDP_PORT, Operator, eampcd, law_bytes

DEPLOY = Path(__file__).parents[2] / "deploy"
UNIT = DEPLOY / "systemd" / "eampcd.service"
NOBODY = 65534
AS_ROOT = [] if os.geteuid() == 0 else ["sudo", "-n"]
# 0.4 s instead of the unit's 5 s: four feedings in half a second of test.
WATCHDOG_US = 400_000


def setting(name: str) -> str:
    found = re.findall(rf"^{name}=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(found) == 1, f"{name} stands {len(found)} times in the unit"
    return found[0]


def with_limits() -> list[str]:
    """The unit's limits, for the command behind it."""
    megabytes = int(setting("LimitMEMLOCK").removesuffix("M"))
    memory = megabytes << 20
    priority = int(setting("LimitRTPRIO"))
    return ["prlimit", f"--rtprio={priority}:{priority}", f"--memlock={memory}:{memory}"]


@pytest.mark.parametrize("name", ["eampcd.service", "lcm-route.service"])
def test_units_are_understood(name: str, tmp_path: Path) -> None:
    """The paths of an installation are not here: another program and no environment file."""
    text = (DEPLOY / "systemd" / name).read_text(encoding="utf-8")
    text = text.replace("/opt/eampc/bin/eampcd", "/bin/true").replace("File=/", "File=-/")
    for other in ("eampcd.service", "lcm-route.service"):
        shutil.copy(DEPLOY / "systemd" / other, tmp_path)
    (tmp_path / name).write_text(text, encoding="utf-8")
    told = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", tmp_path / name], capture_output=True, text=True
    )
    ours = [line for line in told.stderr.splitlines() if name in line]
    assert told.returncode == 0 or not ours, told.stderr
    assert not ours, told.stderr


def test_the_unit_is_exposed_as_little_as_the_page_says() -> None:
    told = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", "--no-pager", UNIT],
        capture_output=True,
        text=True,
    )
    exposure = re.search(r"Overall exposure level for eampcd.service: ([0-9.]+)", told.stdout)
    assert exposure, told.stdout + told.stderr
    page = (DEPLOY / "README.md").read_text(encoding="utf-8")
    stated = re.search(r"exposure level of ([0-9.]+)", page)
    assert stated is not None
    assert float(exposure[1]) <= float(stated[1]) <= 3.0


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that everybody may enter, with the daemon and its own libraries."""
    with tempfile.TemporaryDirectory(prefix="eampcd-") as name:
        folder = Path(name)
        folder.chmod(0o777)
        shutil.copy(eampcd(), folder / "eampcd")
        linked = subprocess.run(["ldd", eampcd()], capture_output=True, text=True, check=True)
        for library in re.findall(r"=> (/\S+)", linked.stdout):
            if not library.startswith(("/lib", "/usr")):
                shutil.copy(library, folder)
        (folder / "toy.law").write_bytes(law_bytes())
        yield folder


def heard(manager: socket.socket, wanted: str, limit_s: float = 60.0) -> list[str]:
    """Everything the manager hears up to the first datagram that holds `wanted`."""
    datagrams: list[str] = []
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        manager.settimeout(max(0.01, end - time.monotonic()))
        datagrams.append(manager.recv(4096).decode())
        if wanted in datagrams[-1]:
            return datagrams
    raise AssertionError(f"{wanted} was not heard, only {datagrams}")


def may_raise_limits() -> bool:
    """Inside some containers root itself may not: there the same is had by two capabilities."""
    told = subprocess.run([*AS_ROOT, *with_limits(), "true"], capture_output=True)
    return told.returncode == 0


def as_nobody(folder: Path, capabilities: tuple[str, ...], *environment: str) -> list[str]:
    """eampcd with a toy law, run by nobody with these capabilities and no way to more."""
    only = ",".join(["-all", *(f"+{name}" for name in capabilities)])
    return [
        *("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"),
        *(f"--inh-caps={only}", f"--ambient-caps={only}", f"--bounding-set={only}"),
        *("--no-new-privs", "env", f"LD_LIBRARY_PATH={folder}", *environment),
        *(str(folder / "eampcd"), f"--law={folder / 'toy.law'}", "--emulation"),
        *(f"--bus=udp_multicast:239.74.163.2:{UDP_PORT}", f"--socket={folder / 's'}"),
        *("--lcm-url=none", "--realtime=enforce"),
    ]


def test_without_a_right_to_real_time_the_daemon_says_what_it_lacks(open_folder: Path) -> None:
    done = subprocess.run(
        [*AS_ROOT, "prlimit", "--rtprio=0:0", "--memlock=65536:65536", *as_nobody(open_folder, ())],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1, done.stderr
    assert "real time was refused" in done.stderr
    assert "CAP_SYS_NICE" in done.stderr
    assert "CAP_IPC_LOCK" in done.stderr


def test_the_daemon_needs_no_root_and_no_more_than_its_rights(open_folder: Path) -> None:
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(str(open_folder / "notify"))
    (open_folder / "notify").chmod(0o777)
    limits = may_raise_limits()
    capabilities = () if limits else ("sys_nice", "ipc_lock")
    effective = 0 if limits else 1 << 23 | 1 << 14
    environment = (f"NOTIFY_SOCKET={open_folder / 'notify'}", f"WATCHDOG_USEC={WATCHDOG_US}")
    command = [
        *AS_ROOT,
        *(with_limits() if limits else []),
        *as_nobody(open_folder, capabilities, *environment),
    ]
    with (open_folder / "log").open("wb") as log:
        process = subprocess.Popen(command, stderr=log)
    try:
        ready = heard(manager, "READY=1")
        assert ready == ["READY=1\nSTATUS=INIT"], (open_folder / "log").read_text()

        inode = os.stat(open_folder / "s")
        assert (inode.st_uid, inode.st_mode & 0o777) == (NOBODY, 0o600)
        if os.geteuid() == 0:
            pid = process.pid
            status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
            assert re.search(rf"^Uid:\s+{NOBODY}\s+{NOBODY}\s+{NOBODY}", status, re.MULTILINE)
            for kind in ("CapInh", "CapPrm", "CapEff", "CapBnd", "CapAmb"):
                held = re.search(rf"^{kind}:\s+([0-9a-f]+)$", status, re.MULTILINE)
                assert held is not None
                assert int(held[1], 16) == effective, kind
            policies = [
                os.sched_getscheduler(int(task.name))
                for task in Path(f"/proc/{pid}/task").iterdir()
            ]
            # The control thread alone has a real-time policy.
            assert policies.count(os.SCHED_FIFO) == 1
            locked = re.search(r"^VmLck:\s+(\d+) kB", status, re.MULTILINE)
            assert locked is not None
            assert 0 < int(locked[1]) << 10 < int(setting("LimitMEMLOCK").removesuffix("M")) << 20
            told = Operator(open_folder / "s").ask(command="status")["realtime_text"]
            assert told == "SCHED_FIFO priority 70, memory locked"

        for _ in range(3):  # no frame has come, but the loop turns
            assert "WATCHDOG=1" in heard(manager, "WATCHDOG=1")
        subprocess.run([*AS_ROOT, "kill", f"-{signal.SIGTERM.value}", str(process.pid)], check=True)
        heard(manager, "STOPPING=1")
        assert process.wait(60) == 0
    finally:
        if process.poll() is None:
            subprocess.run([*AS_ROOT, "kill", "-9", str(process.pid)])
            process.wait(10)
        manager.close()
