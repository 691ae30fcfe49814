"""The whole loop on a real vcan0: daemon, emulator and, beside them, can-utils and python-can.

Runs where vcan0 exists (tools/vcanrun). Time limits are generous: in user-mode Linux a system call
costs 100 µs and there is one processor.
"""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import cantools.database
import pytest

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(900)]

ROOT = Path(__file__).parents[2]
BUS = "vcan0"
RUN_LIMIT_S = 600
# What is kept from run to run: laws, most of them designed by the tests outside this kernel, and
# matplotlib's list of fonts. A guest forgets everything but the working directory.
CACHE = ROOT / "build" / "test-cache"
ENVIRONMENT = {
    **os.environ,
    "XDG_CACHE_HOME": str(CACHE),
    "MPLCONFIGDIR": str(CACHE / "matplotlib"),
}
LINE = re.compile(r"^\(\d+\.\d+\) vcan0 ([0-9A-F]{3})#([0-9A-F]*)$")


def hil(rig: str, out: Path, *options: str) -> tuple[int, dict[str, Any], str]:
    """Exit code, summary and output of one lock-step `eampc hil` on vcan0."""
    command = [sys.executable, "-m", "eampc.command_line", "hil", str(ROOT / "rigs" / rig)]
    command += ["--bus", f"socketcan:{BUS}", "--lockstep", "--out", str(out), *options]
    done = subprocess.run(
        command, env=ENVIRONMENT, capture_output=True, text=True, timeout=RUN_LIMIT_S
    )
    output = done.stdout + done.stderr
    assert done.returncode in (0, 1), output
    return done.returncode, json.loads((out / "summary.json").read_text()), output


@contextlib.contextmanager
def candump(path: Path) -> Iterator[None]:
    """candump -L of the bus into `path`; listening before the context begins."""
    with open(path, "wb") as log:
        dump = subprocess.Popen(["candump", "-L", "-r", "4000000", BUS], stdout=log)
        try:
            marker = path.stat().st_size
            deadline = time.monotonic() + 60
            while path.stat().st_size == marker:  # a frame of our own proves that it listens
                assert time.monotonic() < deadline, "candump hears nothing"
                subprocess.run(["cansend", BUS, "7FF#00"], check=True)
                time.sleep(0.1)
            yield
            time.sleep(0.5)
        finally:
            dump.send_signal(signal.SIGINT)
            dump.wait(30)


def frames(path: Path) -> list[tuple[int, bytes]]:
    """(id, data) of every frame but our own markers."""
    found = [LINE.match(line) for line in path.read_text().splitlines()]
    assert all(found)
    pairs = [(int(hit[1], 16), bytes.fromhex(hit[2])) for hit in found if hit]
    return [pair for pair in pairs if pair[0] != 0x7FF]


def voltages(rig: str, seen: list[tuple[int, bytes]]) -> tuple[int, float, float]:
    """Number of ValveCommand frames, and the extremes of u1 and u2 in them, decoded by cantools."""
    folder = ROOT / "rigs" / rig
    database = cantools.database.load_file(next(folder.glob("*.dbc")))
    message = database.get_message_by_name("ValveCommand")
    decoded = [message.decode(data) for frame, data in seen if frame == message.frame_id]
    both = [float(values[name]) for values in decoded for name in ("U1", "U2")]
    return len(decoded), min(both), max(both)


@pytest.fixture(scope="module")
def reference_run(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Every scenario of the reference rig, once, with candump beside it."""
    folder = tmp_path_factory.mktemp("reference")
    with candump(folder / "bus.log"):
        code, summary, output = hil("reference", folder / "report")
    return {"code": code, "summary": summary, "output": output, "bus": frames(folder / "bus.log")}


def test_reference_rig_tracks_within_the_stated_figures(reference_run: dict[str, Any]) -> None:
    """0.5 Hz ±0.5 rad sine 4 mrad RMS; 0.5 rad step 1.5 mrad RMS after 1 s, 0.2 mrad at the end."""
    assert reference_run["code"] == 0, reference_run["output"]
    scenarios = reference_run["summary"]["scenarios"]
    assert scenarios["sine"]["rms_error_rad"] <= 4e-3
    assert scenarios["step"]["rms_error_rad"] <= 1.5e-3
    assert scenarios["step"]["final_error_rad"] <= 0.2e-3
    assert set(scenarios) == {"step", "sine", "load"}
    for scenario in scenarios.values():
        assert scenario["missed_cycles"] == 0
        assert scenario["angle_max_abs_rad"] <= 1.0
        assert scenario["velocity_max_abs_rad_s"] <= 6.0


def test_every_frame_on_the_bus_is_within_the_valves_range(reference_run: dict[str, Any]) -> None:
    """Read by candump and cantools: neither knows our codec."""
    count, lowest, highest = voltages("reference", reference_run["bus"])
    # Arming 120, reduced limits 40, scenario 1200, stopping 220 frames; three scenarios.
    assert count >= 3 * 1580
    assert lowest >= 0.0
    assert highest <= 10.0
    assert highest > 5.0


def test_one_command_answers_one_encoder_frame(reference_run: dict[str, Any]) -> None:
    """Three runs; at the end of each the daemon says once more that the valves are to be safe."""
    letters = {0x181: "E", 0x201: "C"}
    talk = "".join(letters.get(frame, "") for frame, _ in reference_run["bus"])
    assert re.fullmatch(r"(?:(?:EC){1580}C?){3}", talk)


def test_kalman_estimator_needs_no_velocity_signal(tmp_path: Path) -> None:
    """17-bit position only: 5 mrad RMS on the sine, 2 mrad on the step."""
    code, summary, output = hil("reference", tmp_path, "--variant", "kalman")
    assert code == 0, output
    assert summary["scenarios"]["sine"]["rms_error_rad"] <= 5e-3
    assert summary["scenarios"]["step"]["rms_error_rad"] <= 2e-3


def test_design_without_the_valves_limit_cycles(tmp_path: Path) -> None:
    """The reason for the third state: the valve's lag is in the emulator, but not in the design."""
    code, summary, output = hil(
        "reference", tmp_path, "--variant", "ideal-valve-design", "--scenario", "step"
    )
    assert code == 1, output
    assert "not met" in output
    # A prototype swung by 0.1 rad RMS; the design with the valves stays below 1.5 mrad.
    assert summary["scenarios"]["step"]["rms_error_rad"] > 0.02


@pytest.mark.parametrize(
    ("rig", "variant", "final_rad"),
    [
        ("paper-case1", None, 30e-3),
        ("paper-case1", "tracking", 0.5e-3),
        ("paper-case2", None, 1e-3),
        ("paper-case2", "tracking", 0.5e-3),
    ],
)
def test_paper_cases_end_where_they_should(
    tmp_path: Path, rig: str, variant: str | None, final_rad: float
) -> None:
    options = ["--variant", variant] if variant else []
    code, summary, output = hil(rig, tmp_path, *options)
    assert code == 0, output
    assert summary["scenarios"]["step"]["final_error_rad"] <= final_rad


def test_two_lock_step_runs_say_the_same(tmp_path: Path) -> None:
    """Byte for byte in candump -L, but for the time stamps."""
    logs = []
    for number in range(2):
        with candump(tmp_path / f"{number}.log"):
            code, _, output = hil("reference", tmp_path / str(number), "--scenario", "sine")
        assert code == 0, output
        logs.append(frames(tmp_path / f"{number}.log"))
    assert len(logs[0]) >= 2 * 1540
    assert logs[0] == logs[1]


def test_own_bus_log_is_what_candump_saw(tmp_path: Path) -> None:
    with candump(tmp_path / "theirs.log"):
        code, _, output = hil(
            "reference", tmp_path, "--scenario", "load", "--candump", str(tmp_path / "ours.log")
        )
    assert code == 0, output
    ours = frames(tmp_path / "ours.log")
    assert len(ours) >= 2 * 1540
    assert ours == frames(tmp_path / "theirs.log")


def test_other_tools_join_the_bus_during_a_run(tmp_path: Path) -> None:
    """cansend speaks and a python-can client listens while daemon and emulator are at work."""
    heard: set[int] = set()
    command = [sys.executable, "-m", "eampc.command_line", "hil", str(ROOT / "rigs" / "reference")]
    command += ["--bus", f"socketcan:{BUS}", "--scenario", "load", "--out", str(tmp_path)]
    with can.Bus(interface="socketcan", channel=BUS) as client, candump(tmp_path / "bus.log"):
        run = subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True)
        deadline = time.monotonic() + RUN_LIMIT_S
        commands, senders = 0, []
        while time.monotonic() < deadline:
            message = client.recv(1.0)
            if message is None:
                if run.poll() is not None:
                    break
                continue
            heard.add(message.arbitration_id)
            commands += message.arbitration_id == 0x201
            if message.arbitration_id == 0x201 and commands % 300 == 100:
                # Not waited for: the client's queue would run over meanwhile.
                senders.append(subprocess.Popen(["cansend", BUS, "123#DEADBEEF"]))
        assert [sender.wait(10) for sender in senders] == [0] * len(senders)
        output, _ = run.communicate(timeout=30)
    assert run.returncode == 0, output  # the stranger's frame did no harm
    assert {0x123, 0x181, 0x182, 0x201} <= heard
    assert (0x123, bytes.fromhex("DEADBEEF")) in frames(tmp_path / "bus.log")
