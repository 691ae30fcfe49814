"""`eampc hil --fault` as a user runs it: real daemon, real emulator, udp_multicast, lock-step."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.timeout(600)

# A port of these tests' own: nobody else's frames may mix with theirs.
BUS = "udp_multicast:239.74.163.15:43215"
# A law that is designed in a second; what is judged here is the stop.
SMALL = ["control.horizon=10", "control.control_horizon=2", "constraints.stage_step=10"]
Eampc = Callable[..., subprocess.CompletedProcess[str]]


def hil(eampc: Eampc, out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    changes = [word for change in SMALL for word in ("--set", change)]
    return eampc(
        *("hil", "rigs/reference", "--scenario", "sine", "--bus", BUS, "--out", out),
        *(*changes, "--lcm-url", "none", *arguments),
    )


def test_answered_fault_is_told_in_terminal_summary_and_page(eampc: Eampc, tmp_path: Path) -> None:
    """The second fault finds the joint at rest: seen, and nothing is left to do."""
    done = hil(eampc, tmp_path, "--fault", "e_stop@1.0..1.2", "--fault", "encoder_crc@3.0")
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())["scenarios"]["sine"]
    first, second = summary["faults"]
    assert (first["name"], first["state"], first["detected_cycles"]) == ("e_stop", "ACTIVE", 1)
    assert first["action"] == "immediate"
    assert first["deviation_V"] <= 1e-9
    assert (second["name"], second["state"], second["action"]) == ("encoder_crc", "FAULT", "none")
    assert second["detected_cycles"] == 3
    wire = summary["wire"]
    assert wire["frames"] > 1300
    assert wire["voltage_violations"] == wire["slew_violations"] == wire["automatic_resumes"] == 0
    assert "e_stop" in done.stdout
    page = (tmp_path / "index.html").read_text()
    assert "every fault answered" in page
    assert "e_stop from 1 to 1.2 s: the emergency stop is pressed" in page


def test_fault_that_the_daemon_does_not_see_is_exit_1(eampc: Eampc, tmp_path: Path) -> None:
    """A heartbeat that is late by less than its time-out is none."""
    done = hil(eampc, tmp_path, "--fault", "heartbeat_lost@1.0..1.1")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "not met: sine: heartbeat_lost in ACTIVE: seen after nan cycles" in done.stdout
    assert "a fault was not answered" in (tmp_path / "index.html").read_text()


def test_list_says_what_happens_and_what_cannot(eampc: Eampc, tmp_path: Path) -> None:
    done = hil(eampc, tmp_path, "--fault", "list")
    assert done.returncode == 0
    assert "encoder_out_of_range" in done.stdout
    assert "not here: udp_multicast has no CAN" in " ".join(done.stdout.replace("│", " ").split())
    assert not (tmp_path / "summary.json").exists()


def test_wrong_fault_is_exit_2_and_one_sentence(eampc: Eampc, tmp_path: Path) -> None:
    done = hil(eampc, tmp_path, "--fault", "link_down@1")
    assert done.returncode == 2
    assert done.stderr.startswith('eampc: --fault "link_down@1": udp_multicast has no CAN')
    assert done.stderr.count("\n") == 1
