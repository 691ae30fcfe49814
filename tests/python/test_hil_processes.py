"""Starting, watching and ending the programs of a run, with small programs of the test's own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from eampc.errors import RunFailed, UserError
from eampc.hil.processes import Ensemble, Process

READY = """
import os, sys, time
os.write(int(sys.argv[sys.argv.index('--ready-fd') + 1]), b'ready\\n')
time.sleep(600)
"""


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def gone_within(pid: int, limit_s: float) -> bool:
    deadline = time.monotonic() + limit_s
    while alive(pid):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def test_daemon_is_handed_over_when_it_says_ready(tmp_path: Path) -> None:
    with Ensemble() as ensemble:
        daemon = ensemble.start_daemon(python(READY), tmp_path / "log")
        assert daemon.running()
        assert daemon.peak_memory_MB() > 1.0
    assert not daemon.running()


def test_daemon_that_dies_before_ready_gives_its_own_sentence(tmp_path: Path) -> None:
    code = "import sys; sys.exit(print('eampcd: the bus is down', file=sys.stderr) or 1)"
    with Ensemble() as ensemble, pytest.raises(RunFailed, match="eampcd: the bus is down"):
        ensemble.start_daemon(python(code), tmp_path / "log")


def test_bad_input_of_the_daemon_stays_bad_input(tmp_path: Path) -> None:
    code = "import sys; print('eampcd: no such law', file=sys.stderr); sys.exit(2)"
    with Ensemble() as ensemble, pytest.raises(UserError) as caught:
        ensemble.start_daemon(python(code), tmp_path / "log")
    assert str(caught.value) == "eampcd: no such law"
    assert caught.value.exit_code == 2


def test_death_of_the_daemon_ends_the_run(tmp_path: Path) -> None:
    dies = READY.replace("time.sleep(600)", "time.sleep(0.2); print('eampcd: out'); sys.exit(1)")
    with Ensemble() as ensemble:
        ensemble.start_daemon(python(dies), tmp_path / "daemon.log")
        other = ensemble.start(
            Process("plant_emulator", python("import time; time.sleep(600)"), tmp_path / "log")
        )
        with pytest.raises(RunFailed, match=r"eampcd failed \(1\); eampcd: out"):
            for _ in ensemble.supervise(other, 30.0):
                pass
    assert not other.running()


def test_run_that_hangs_is_ended(tmp_path: Path) -> None:
    with Ensemble() as ensemble:
        hangs = ensemble.start(
            Process("plant_emulator", python("import time; time.sleep(600)"), tmp_path / "log")
        )
        with pytest.raises(RunFailed, match="did not end within 0 s"):
            for _ in ensemble.supervise(hangs, 0.2):
                pass
    assert not hangs.running()


def test_child_that_ignores_sigterm_is_killed_with_its_group(tmp_path: Path) -> None:
    stubborn = (
        "import os, signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
        "child = os.fork() or time.sleep(600); print(child, flush=True); time.sleep(600)"
    )
    log = tmp_path / "log"
    process = Process("plant_emulator", python(stubborn), log)
    while not log.read_text().strip():
        time.sleep(0.02)
    process.stop(grace_s=0.3)
    assert process.exit_code() == -signal.SIGKILL
    assert gone_within(int(log.read_text()), 5.0)


def test_killed_parent_leaves_nothing_behind(tmp_path: Path) -> None:
    script = f"""
import time
from pathlib import Path
from eampc.hil.processes import Process
child = Process('x', {python("import time; time.sleep(600)")!r}, Path({str(tmp_path / "log")!r}))
print(child.pid, flush=True)
time.sleep(600)
"""
    parent = subprocess.Popen(python(script), stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    assert alive(child)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    assert gone_within(child, 5.0)


def test_program_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot start /no/such/program: No such file"):
        Process("x", ["/no/such/program"], tmp_path / "log")
