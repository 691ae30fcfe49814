"""Did the daemon answer the faults of a run as the rig file says? Judged on the command frames as
the emulated node received them, and on the daemon's record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from eampc_rig import Rig
from eampc_rig.safety_section import FAULT_NAMES
from numpy.typing import NDArray

from eampc.hil.assessment import NO_FAULT, Judged
from eampc.hil.fault_plan import PlannedFault
from eampc.hil.recording import Recording
from eampc.hil.stop_on_the_wire import STRENGTH, stop_frames

MOVING = ("ARMING", "ACTIVE", "SOFT_STOP")
# Half a step of the command's signal, in steps of the DBC's usual millivolt, both voltages rounded.
ROUNDING_V = 1.1e-3
# In real time a cycle without an encoder frame runs half a period late, and the frame that it sends
# belongs to either period.
REAL_TIME_PERIODS = 2

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FaultVerdict:
    """What became of one fault.

    state             the daemon's mode in the cycle before the fault began
    detected_cycles   cycles from the fault's first to the one that reported it, that one included;
                      None: never
    action            as on the wire: the rig file's, or "none" where nothing moved any more
    deviation_V       largest distance of a command frame from that action's voltages; None where
                      there was none to compare
    latched           every later cycle reported a fault, and the run ended at rest
    """

    name: str
    raised: str
    state: str
    detected_cycles: int | None
    limit_cycles: int
    action: str
    deviation_V: float | None
    latched: bool

    def as_summary(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class WireFigures:
    """Counts over every command frame of the run."""

    frames: int
    invalid_frames: int
    voltage_violations: int
    slew_violations: int
    automatic_resumes: int


def judge_wire(rig: Rig, commands: Recording, armings: Sequence[int]) -> WireFigures:
    """armings: encoder frames in which an operator armed the joint; the enable bit may rise after
    each of them once, and never otherwise."""
    valve, period_s = rig.valve, rig.control.period_s
    valid = commands.where(commands["valid"] == 1.0)
    voltages = np.column_stack([valid["u1_V"], valid["u2_V"]])
    frame = valid["frame"]
    # Without an enable bit (CANopen's analogue outputs) the safe voltage alone means disabled.
    at_safe = np.all(np.abs(voltages - valve.safe_V) <= ROUNDING_V, axis=1)
    enable = np.where(np.isnan(valid["enable"]), ~at_safe, valid["enable"] == 1.0)
    beyond = (voltages < valve.min_V - 1e-9) | (voltages > valve.max_V + 1e-9)
    # A disabled node is to apply its safe voltage; the frame says the same.
    unsafe = ~enable & ~at_safe
    steps = np.maximum(1.0, np.diff(frame))
    allowed_V = valve.slew_max_V_per_s * period_s * steps + ROUNDING_V
    moved_V = np.max(np.abs(np.diff(voltages, axis=0)), axis=1) if len(frame) > 1 else np.empty(0)
    rises = np.flatnonzero(enable & ~np.concatenate([[False], enable[:-1]]))
    ordered = sum(
        bool(np.any((frame[rises] >= begin) & (frame[rises] < end)))
        for begin, end in pairwise([*armings, np.inf])
    )
    return WireFigures(
        frames=len(commands),
        invalid_frames=int(len(commands) - len(valid)),
        voltage_violations=int(np.count_nonzero(np.any(beyond, axis=1) | unsafe)),
        slew_violations=int(np.count_nonzero(enable[1:] & (moved_V > allowed_V))),
        automatic_resumes=int(len(rises) - ordered),
    )


def judge_fault(
    rig: Rig,
    fault: PlannedFault,
    record: Recording,
    commands: Recording,
    lockstep: bool,
) -> FaultVerdict:
    """The record may go on after a reset: what is judged ends where the latch was taken back."""
    frame_of = _frames_of_rows(record, commands, lockstep)
    before = record.where(frame_of < fault.first)
    state = str(before["mode"][-1]) if len(before) else "INIT"
    bit = 1 << (FAULT_NAMES.index(fault.raised) + 1)
    seen = (frame_of >= fault.first) & ((record["present_faults"].astype(np.int64) & bit) != 0)
    if not np.any(seen):
        return _verdict(fault, state, None, "none", None, False)
    row = int(np.argmax(seen))
    detected = int(frame_of[row]) - fault.first + 1
    mode = str(record["mode"][row - 1]) if row else "INIT"
    was_latched = row > 0 and str(record["fault"][row - 1]) not in NO_FAULT
    rows = np.arange(len(record))
    if mode not in MOVING or was_latched:
        modes = {str(name) for name in record["mode"][(rows >= row) & (frame_of < fault.end)]}
        at_rest = modes <= ({"SOFT_STOP", "FAULT"} if was_latched else {"INIT", "DISARMED"})
        return _verdict(fault, state, detected, "none", None, at_rest)
    cleared = [index for index in rows[row:] if str(record["fault"][index]) in NO_FAULT]
    until = cleared[0] if cleared else len(record)
    deviation = _deviation(rig, fault, row, until, record, commands, lockstep)
    held = record.where((rows >= row) & (rows < until))
    latched = len(held) > 0 and bool(np.all(held["fault"] == fault.raised))
    latched = latched and str(held["mode"][-1]) == "FAULT"
    return _verdict(fault, state, detected, fault.action, deviation, latched)


def _frames_of_rows(record: Recording, commands: Recording, lockstep: bool) -> Array:
    """The encoder frame that each row of the record answers. In lock-step row and command frame
    belong together one by one; a repeated frame has a row, but no cycle of its own."""
    frames = record["cycle"].copy()
    if lockstep:
        both = min(len(frames), len(commands))
        frames[:both] = commands["frame"][:both]
    return frames


def _verdict(
    fault: PlannedFault,
    state: str,
    detected: int | None,
    action: str,
    deviation_V: float | None,
    latched: bool,
) -> FaultVerdict:
    return FaultVerdict(
        fault.entry.name, fault.raised, state, detected, fault.limit, action, deviation_V, latched
    )


def _deviation(
    rig: Rig,
    fault: PlannedFault,
    row: int,
    until: int,
    record: Recording,
    commands: Recording,
    lockstep: bool,
) -> float:
    """Largest distance in V of the frames on the wire from the action's, for rows row ≤ k < until
    of the record; infinite if an enable bit is wrong or no frame came."""
    cycle, mode = int(record["cycle"][row]), str(record["mode"][row - 1])
    ramping_up = mode == "ARMING" and record["region"][row - 1] < 0
    first, begins = row, {}
    if mode == "SOFT_STOP":  # the operator's, as no fault was latched
        first = int(np.flatnonzero(record["mode"][:row] != "SOFT_STOP")[-1]) + 1
        begins[0] = "soft_stop"
    begin = int(record["cycle"][first])
    # A later cause makes the stop stronger, never weaker.
    for later in range(row, until):
        if causes := int(record["present_faults"][later]):
            begins[int(record["cycle"][later]) - begin] = _strongest(rig, causes)
    last_V = (float(record["u1_V"][first - 1]), float(record["u2_V"][first - 1]))
    last_cycle = int(record["cycle"][until - 1])
    expected = stop_frames(rig, last_V, begins, last_cycle - begin + 1, ramping_up)
    if lockstep:
        wire, cycles = commands, record["cycle"][: len(commands)]
        index = np.arange(len(cycles))
        chosen = (index >= row) & (index < until)
        wire = commands.where(np.pad(chosen, (0, len(commands) - len(chosen))))
        cycles = cycles[chosen]
    else:
        # The answer to the cycle before may arrive in this one's period.
        wire = commands.where((commands["frame"] > cycle) & (commands["frame"] <= last_cycle))
        if fault.raised == "tx_unconfirmed":  # the one frame in flight still comes, late
            wire = wire.where(np.arange(len(wire)) > 0)
        cycles = wire["frame"]
    if len(wire) == 0 or not np.all(wire["valid"] == 1.0):
        return float("inf")
    rows = cycles.astype(int) - begin
    slack = 0 if lockstep else REAL_TIME_PERIODS
    distance = np.full(len(rows), np.inf)
    for shift in range(-slack, slack + 1):
        of = expected[np.clip(rows + shift, 0, len(expected) - 1)]
        here = np.maximum(np.abs(wire["u1_V"] - of[:, 0]), np.abs(wire["u2_V"] - of[:, 1]))
        same = np.isnan(wire["enable"]) | (wire["enable"] == of[:, 2])
        distance = np.minimum(distance, np.where(same, here, np.inf))
    return float(np.max(distance))


def _strongest(rig: Rig, causes: int) -> str:
    """The strongest action on these causes, bit n for cause n."""
    names = [name for number, name in enumerate(FAULT_NAMES, start=1) if causes >> number & 1]
    return max((rig.safety.action(name) for name in names), key=STRENGTH.index)


def fault_demands(
    verdicts: Sequence[FaultVerdict], wire: WireFigures, lockstep: bool
) -> list[Judged]:
    """What a run with faults must meet, in place of the scenario's tolerances."""
    slack = 0 if lockstep else REAL_TIME_PERIODS
    demands = []
    for verdict in verdicts:
        cycles = float("nan") if verdict.detected_cycles is None else verdict.detected_cycles
        name = f"{verdict.name} in {verdict.state}"
        limit = verdict.limit_cycles + slack
        demands.append(Judged(f"{name}: seen after", cycles, limit, "cycles"))
        if verdict.deviation_V is not None:
            title = f"{name}: distance from {verdict.action} on the wire"
            demands.append(Judged(title, verdict.deviation_V, ROUNDING_V, "V"))
        demands.append(Judged(f"{name}: latches lost", float(not verdict.latched), 0, ""))
    return [
        *demands,
        Judged("command frames of wrong length or CRC", wire.invalid_frames, 0, ""),
        Judged("voltage violations", wire.voltage_violations, 0, ""),
        Judged("slew violations", wire.slew_violations, 0, ""),
        Judged("automatic resumes", wire.automatic_resumes, 0, ""),
    ]
