"""Faults of the interface in every state, in real time on a real vcan0: link down, queue full,
queue held, and a daemon that misses its deadlines.

At 25 Hz and with long time-outs for everything else: in user-mode Linux a system call costs 100 µs
and there is one processor, which a loaded host takes away for tens of milliseconds.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

import numpy as np
from eampc.hil.fault_assessment import judge_wire
from eampc.hil.recording import Recording
from eampc_rig import FAULT_NAMES, Rig
from eampc_rig.fault_catalogue import catalogue_entry
from fault_bench import FaultBench, short_rig, write_table

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(900)]

ROOT = Path(__file__).parents[2]
URL = "socketcan:vcan0"
STATES = ("DISARMED", "ARMING", "ACTIVE", "SOFT_STOP", "FAULT")
SLOW = {
    "control__period_s": 0.04,
    "control__horizon": 6,
    "constraints__stage_step": 6,
    "safety__encoder_timeout_s": 0.32,
    "safety__encoder_counter_gap_max": 12,
    "emulator__valve_timeout_s": 0.16,
    "safety__arming_ramp_s": 0.6,
    "safety__reduced_limits_s": 0.08,
    "safety__soft_stop_ramp_s": 0.6,
    "safety__heartbeat_timeout_s": 2.0,
    "safety__supply_pressure_s": 2.0,
    "safety__deadline_overruns_max": 6,
    "safety__deadline_overruns_window_s": 2.0,
}
# What a fault of the interface brings with it; whichever the daemon sees first is right.
KIN = {
    "link_down": {"link_down", "send_refused", "tx_unconfirmed", "encoder_timeout"},
    "send_refused": {"send_refused", "tx_unconfirmed", "encoder_timeout"},
    "tx_unconfirmed": {"tx_unconfirmed", "encoder_timeout"},
    "deadline_overruns": {"deadline_overruns"},
}
# The daemon's period without a frame begins half a period late, its answer another one later.
LATE_CYCLES = 2
QUIET_FRAMES = 10


def bring_to(bench: FaultBench, state: str) -> None:
    """A machine that stalls is a fault, too: then it is acknowledged and tried again."""
    for _ in range(10):
        come_to_rest(bench)
        if state != "DISARMED":
            bench.order("arm")
        if state in ("ACTIVE", "SOFT_STOP", "FAULT"):
            bench.step(round(1.0 / bench.rig.control.period_s))
        if state == "SOFT_STOP":
            bench.order("disarm")
        if state == "FAULT":
            bench.faults.add("e_stop", bench.frame, 1)
            bench.step(3)
        if bench.status()["mode"] == state:
            return
    raise AssertionError(f"{state} was not reached: {bench.status()}")


def come_to_rest(bench: FaultBench) -> None:
    """DISARMED by the operator's own edges."""
    for _ in range(50):
        mode = bench.status()["mode"]
        if mode == "DISARMED":
            return
        if mode in ("ARMING", "ACTIVE"):
            bench.order("disarm")
        elif mode == "FAULT":
            bench.order("reset")
        else:
            bench.step(5)
    raise AssertionError(f"never at rest: {bench.status()}")


def episode(bench: FaultBench, state: str, name: str) -> dict[str, tuple[int, int]]:
    """The fault in the state, from frame to frame and from cycle to cycle; afterwards at rest."""
    rig = bench.rig
    bring_to(bench, state)
    held = catalogue_entry(name).limit(rig) + 8
    first, cycle = bench.frame, bench.status()["cycle"] + 1
    bench.faults.add(name, first, held)
    bench.step(held)
    if name != "deadline_overruns":  # nothing reached the node: it went to its own safe value
        assert bench.valve_node.timed_out
        assert bench.valve_node.u1_V == bench.valve_node.u2_V == rig.valve.safe_V
    bench.step(QUIET_FRAMES)
    if state != "DISARMED":
        bench.until("FAULT")
        bench.order("arm")
        assert bench.status()["mode"] == "FAULT", "armed over a latched fault"
    come_to_rest(bench)
    return {"frames": (first, first + held), "cycles": (cycle, cycle + held)}


def detection(record: Recording, name: str, first: int, end: int) -> int | None:
    """Cycles from the fault's first to the first that reported it or its kin."""
    bits = sum(1 << (FAULT_NAMES.index(kin) + 1) for kin in KIN[name])
    rows = (record["cycle"] >= first) & (record["cycle"] < end + LATE_CYCLES)
    seen = rows & ((record["present_faults"].astype(np.int64) & bits) != 0)
    return int(record["cycle"][np.argmax(seen)]) - first + 1 if np.any(seen) else None


def enabled_frames(commands: Recording, first: int, end: int) -> int:
    rows = (commands["frame"] > first + LATE_CYCLES) & (commands["frame"] < end + QUIET_FRAMES)
    return int(np.count_nonzero(commands["enable"][rows] == 1.0))


@pytest.mark.parametrize("name", list(KIN))
def test_fault_of_the_interface_in_every_state(name: str, tmp_path: Path) -> None:
    """Seen in time, the node safe, at most the one frame in flight late, no resume, armed again."""
    rig: Rig = short_rig(**SLOW)
    episodes = {}
    with FaultBench(rig, URL, tmp_path, lockstep=False) as bench:
        bench.step(25)
        for state in STATES:
            episodes[state] = episode(bench, state, name)
        bring_to(bench, "ACTIVE")
        come_to_rest(bench)
    record, commands = bench.logs()
    limit = catalogue_entry(name).limit(rig) + LATE_CYCLES
    seen = {state: detection(record, name, *span["cycles"]) for state, span in episodes.items()}
    wire = judge_wire(rig, commands, bench.armings)
    late = {state: enabled_frames(commands, *span["frames"]) for state, span in episodes.items()}
    row = {
        "fault": name,
        "states": len(seen),
        "worst_detection_cycles": max(cycles or 0 for cycles in seen.values()),
        "limit_cycles": limit,
        "frames": wire.frames,
        "voltage_violations": wire.voltage_violations,
        "slew_violations": wire.slew_violations,
        "automatic_resumes": wire.automatic_resumes,
    }
    write_table(ROOT / "build" / "fault-matrix" / f"interface-{name}.csv", [row])
    print(f"\n{row}, by state {seen}")
    assert all(cycles is not None and cycles <= limit for cycles in seen.values()), seen
    if rig.safety.action(name) == "immediate":
        assert all(count <= 1 for count in late.values()), late
    assert wire.voltage_violations == wire.slew_violations == wire.automatic_resumes == 0
