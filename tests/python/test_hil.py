"""`eampc hil` as a user runs it: real daemon, real emulator, udp_multicast, lock-step.

The tests on a real vcan0 are in tests/vcan/test_closed_loop.py.
"""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from matplotlib.image import imread

pytestmark = pytest.mark.timeout(600)

ROOT = Path(__file__).parents[2]
# A port of these tests' own: nobody else's frames may mix with theirs.
BUS = "udp_multicast:239.74.163.11:43211"
Eampc = Callable[..., subprocess.CompletedProcess[str]]
FIGURES = ["rms_error_rad", "max_error_rad", "final_error_rad", "missed_cycles"]
FIGURES += ["u1_min_V", "u1_max_V", "u2_min_V", "u2_max_V", "passed"]


def summary_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def report(eampc: Eampc, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "deep" / "er"
    done = eampc(
        "hil", "rigs/reference", "--scenario", "all", "--bus", BUS, "--out", folder, timeout_s=500
    )
    (folder / "output.txt").write_text(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_summary_has_the_figures_of_every_scenario(report: Path) -> None:
    summary = summary_of(report)
    assert set(summary["scenarios"]) == {"step", "sine", "load"}
    assert summary["passed"] is True
    for scenario in summary["scenarios"].values():
        for name in FIGURES:
            assert name in scenario
        assert scenario["missed_cycles"] == 0
        assert 0.0 <= scenario["u1_min_V"] < scenario["u1_max_V"] <= 10.0
        assert 0.0 <= scenario["u2_min_V"] < scenario["u2_max_V"] <= 10.0


def test_tracking_is_as_good_as_the_rig_file_says(report: Path) -> None:
    scenarios = summary_of(report)["scenarios"]
    assert scenarios["sine"]["rms_error_rad"] <= 4e-3
    assert scenarios["step"]["rms_error_rad"] <= 1.5e-3
    assert scenarios["step"]["final_error_rad"] <= 0.2e-3
    assert all(scenario["angle_max_abs_rad"] <= 1.0 for scenario in scenarios.values())
    assert all(scenario["velocity_max_abs_rad_s"] <= 6.0 for scenario in scenarios.values())


def test_figures_can_be_computed_from_the_logs_again(report: Path) -> None:
    """RMS of the sine by hand from truth.csv: 0.5 sin(π t) against the emulator's angle."""
    from math import pi, sin, sqrt

    with open(report / "sine" / "truth.csv", newline="") as file:
        rows = [
            (float(row["scenario_time_s"]), float(row["angle_rad"])) for row in csv.DictReader(file)
        ]
    errors = [angle - 0.5 * sin(pi * t) for t, angle in rows if -1e-9 <= t < 6.0 - 1e-9]
    assert len(errors) == 1200
    rms = sqrt(sum(error * error for error in errors) / len(errors))
    assert summary_of(report)["scenarios"]["sine"]["rms_error_rad"] == pytest.approx(rms)


def test_page_shows_every_figure_by_a_relative_link(report: Path) -> None:
    page = (report / "index.html").read_text()
    images = re.findall(r'<img src="([^"]+)"', page)
    assert len(images) == 15
    for image in images:
        assert not image.startswith("/")
        assert imread(report / image).shape[0] > 300
    for link in re.findall(r'<a href="([^"]+)"', page):
        assert (report / link).is_file()
    assert "http" not in re.sub(r"<!doctype.*?>", "", page)


def test_table_is_readable_in_a_pipe(report: Path) -> None:
    output = (report / "output.txt").read_text()
    assert "\x1b" not in output
    for scenario in ("step", "sine", "load"):
        assert re.search(rf"{scenario} .*passed", output)
    assert f"report: {report / 'index.html'}" in output


def test_unmet_tolerance_is_exit_1_and_says_which(eampc: Eampc, tmp_path: Path) -> None:
    done = eampc(
        "hil", "rigs/reference", "--scenario", "load", "--bus", BUS, "--out", tmp_path,
        "--set", "scenarios.load.tolerance.rms_error_max_rad=1e-6",
    )  # fmt: skip
    assert done.returncode == 1
    assert "not met: load: RMS error" in done.stdout
    assert summary_of(tmp_path)["passed"] is False


def test_emulated_rig_may_differ_from_the_design(eampc: Eampc, tmp_path: Path) -> None:
    """20 % more inertia in the emulator only: the same law, a larger error."""
    done = eampc(
        "hil", "rigs/reference", "--scenario", "load", "--bus", BUS, "--out", tmp_path / "other",
        "--set-emulator", "joint.moment_of_inertia_kg_m2=0.06",
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    same = eampc("hil", "rigs/reference", "--scenario", "load", "--bus", BUS, "--out", tmp_path)
    assert same.returncode == 0, same.stderr
    other, nominal = summary_of(tmp_path / "other"), summary_of(tmp_path)
    assert other["law_inputs_sha256"] == nominal["law_inputs_sha256"]
    assert other["scenarios"]["load"]["max_error_rad"] != pytest.approx(
        nominal["scenarios"]["load"]["max_error_rad"], rel=0.01
    )


def test_lock_step_repeats_to_the_last_bit(eampc: Eampc, tmp_path: Path) -> None:
    logs = []
    for number in range(2):
        bus_log = tmp_path / f"{number}.log"
        done = eampc(
            "hil", "rigs/reference", "--scenario", "sine", "--bus", BUS,
            "--out", tmp_path / str(number), "--candump", bus_log,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        logs.append([line.split(" ", 1)[1] for line in bus_log.read_text().splitlines()])
    assert len(logs[0]) >= 2 * 1540
    # Multicast promises a third listener no order between two senders: each one's frames are
    # compared for themselves. tests/vcan compares the whole log.
    for logged in logs:
        logged.sort(key=lambda line: line.split("#")[0])
    assert logs[0] == logs[1]


def children_of(pid: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(status.parent.name))
    return found


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
def test_interrupted_run_leaves_nothing_behind(
    eampc_environment: dict[str, str], report: Path, tmp_path: Path, number: signal.Signals
) -> None:
    """Daemon and emulator are ended; `report` has designed the law before."""
    command = [sys.executable, "-m", "eampc.command_line", "hil", "rigs/reference"]
    command += ["--bus", BUS, "--real-time", "--scenario", "sine", "--out", str(tmp_path)]
    run = subprocess.Popen(
        command, cwd=ROOT, env=eampc_environment, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while len(children := children_of(run.pid)) < 2:
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(1.0)
    run.send_signal(number)
    _, complaint = run.communicate(timeout=60)
    assert run.returncode == 128 + number
    assert "Traceback" not in complaint
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]


def test_daemon_that_dies_in_mid_run_is_one_sentence(
    eampc_environment: dict[str, str], report: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "eampc.command_line", "hil", "rigs/reference"]
    command += ["--bus", BUS, "--real-time", "--scenario", "sine", "--out", str(tmp_path)]
    run = subprocess.Popen(
        command, cwd=ROOT, env=eampc_environment, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while len(children := children_of(run.pid)) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    daemon = next(
        pid for pid in children if Path(f"/proc/{pid}/comm").read_text().strip() == "eampcd"
    )
    os.kill(daemon, signal.SIGKILL)
    _, complaint = run.communicate(timeout=60)
    assert run.returncode == 1
    assert complaint.count("\n") == 1
    assert complaint.startswith("eampc: eampcd was ended by signal 9")


def test_demo_says_which_bus_and_why(eampc: Eampc, tmp_path: Path) -> None:
    done = eampc("demo", "--lockstep", "--scenario", "load", "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    first = done.stdout.splitlines()[0]
    assert re.match(r"bus: (socketcan:vcan\d+|udp_multicast:\S+), because .+", first)
