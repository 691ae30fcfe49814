"""All faults x all states on both transports: real eampcd, real bus, emulated rig, in lock-step.

The faults that need an interface's own clock are in tests/vcan/test_interface_faults.py.
"""

import os
from pathlib import Path

import pytest
from eampc.hil.fault_assessment import MOVING, FaultVerdict, judge_fault, judge_wire
from eampc.hil.fault_plan import PlannedFault
from eampc_rig import Rig
from eampc_rig.fault_catalogue import CATALOGUE, CatalogueEntry
from fault_bench import FaultBench, short_rig, write_table

pytestmark = pytest.mark.timeout(900)

ROOT = Path(__file__).parents[2]
STATES = ("DISARMED", "ARMING", "ACTIVE", "SOFT_STOP", "FAULT")
# Every action once at the least, beside the defaults.
ACTIONS = {
    "safety.encoder_length_action": "saturate",
    "safety.encoder_status_action": "vent_ramp",
    "safety.encoder_jump_action": "immediate",
}
# A frozen value is told only while the command moves: neither at rest nor on the arming ramp, where
# both valves rise alike.
ONLY_IN = {"encoder_frozen": ("ACTIVE",)}
QUIET_FRAMES = 15  # after the fault is over: nothing may start by itself


@pytest.fixture(params=["multicast", pytest.param("vcan0", marks=pytest.mark.vcan)])
def url(request: pytest.FixtureRequest) -> str:
    if request.param == "vcan0":
        return "socketcan:vcan0"
    return f"udp_multicast:239.74.163.12:{43300 + os.getpid() % 1000}"


def entries(rig: Rig, url: str) -> list[CatalogueEntry]:
    return [entry for entry in CATALOGUE if entry.refusal(rig, url, lockstep=True) is None]


def bring_to(bench: FaultBench, state: str, entry: CatalogueEntry) -> None:
    if state == "DISARMED":
        return
    bench.order("arm")
    if state == "ARMING":
        return
    bench.until("ACTIVE")
    bench.step(30)
    if state == "SOFT_STOP":
        bench.order("disarm")
    if state == "FAULT":
        first = "emergency_message" if entry.raises == "e_stop" else "e_stop"
        bench.faults.add(first, bench.frame, 1)
        bench.until("FAULT")


def episode(bench: FaultBench, state: str, entry: CatalogueEntry) -> PlannedFault:
    """The fault in the state; afterwards acknowledged and at rest."""
    rig = bench.rig
    bring_to(bench, state, entry)
    assert bench.status()["mode"] == state
    held = entry.hold_periods(rig)
    raised = entry.raised(lockstep=True)
    fault = PlannedFault(
        entry=entry,
        first=bench.frame,
        end=bench.frame + held,
        raised=raised,
        action=rig.safety.action(raised),
        limit=entry.limit_periods(rig, True, held) + (entry.name == "encoder_repeats"),
    )
    bench.faults.add(entry.name, fault.first, held)
    bench.step(held + QUIET_FRAMES)
    if state != "DISARMED":
        bench.until("FAULT")
        bench.order("arm")
        assert bench.status()["mode"] == "FAULT", "armed over a latched fault"
        bench.order("reset")
    assert bench.status()["mode"] == "DISARMED"
    return fault


def test_every_fault_in_every_state(url: str, tmp_path: Path) -> None:
    """Seen in time, the action on the wire, nothing beyond the limits, latched, no resume; after a
    reset the joint arms again and becomes ACTIVE, which is how the next state is reached."""
    rig = short_rig(**{key.replace(".", "__"): value for key, value in ACTIONS.items()})
    planned: list[tuple[str, PlannedFault]] = []
    with FaultBench(rig, url, tmp_path) as bench:
        bench.client.reference("sine", amplitude_rad=0.3, frequency_hz=1.0)
        bench.step(25)
        for entry in entries(rig, url):
            for state in STATES:
                if state in ONLY_IN.get(entry.name, STATES):
                    planned.append((state, episode(bench, state, entry)))
        bench.order("arm")
        bench.until("ACTIVE")
        bench.step(50)
        assert bench.status()["fault"] in ("none", 0, "")
    record, commands = bench.logs()
    verdicts = [judge_fault(rig, fault, record, commands, lockstep=True) for _, fault in planned]
    wire = judge_wire(rig, commands, bench.armings)
    rows = table_of(verdicts)
    transport = url.partition(":")[0]
    write_table(ROOT / "build" / "fault-matrix" / f"{transport}.csv", rows)
    print(
        f"\n{transport}: {len(rows)} faults x {len(STATES)} states, {len(verdicts)} episodes, "
        f"{wire.frames} command frames; voltage violations {wire.voltage_violations}, slew "
        f"violations {wire.slew_violations}, automatic resumes {wire.automatic_resumes}"
    )
    for row in rows:
        print("  " + ", ".join(f"{key} {value}" for key, value in row.items()))
    failed = [verdict for verdict in verdicts if not sound(verdict)]
    assert not failed, "\n".join(map(str, failed))
    assert [verdict.state for verdict in verdicts] == [state for state, _ in planned]
    assert wire.voltage_violations == wire.slew_violations == wire.automatic_resumes == 0
    assert wire.invalid_frames == 0


def sound(verdict: FaultVerdict) -> bool:
    seen = verdict.detected_cycles
    moving = verdict.state in MOVING
    acted = verdict.deviation_V is not None and verdict.deviation_V <= 1.1e-3
    return (
        seen is not None
        and 1 <= seen <= verdict.limit_cycles
        and verdict.latched
        and (acted or not moving)
    )


def table_of(verdicts: list[FaultVerdict]) -> list[dict[str, object]]:
    rows = []
    for name in dict.fromkeys(verdict.name for verdict in verdicts):
        own = [verdict for verdict in verdicts if verdict.name == name]
        rows.append(
            {
                "fault": name,
                "states": len({verdict.state for verdict in own}),
                "worst_detection_cycles": max(verdict.detected_cycles or 0 for verdict in own),
                "limit_cycles": own[0].limit_cycles,
                "action": next(v.action for v in own if v.state in MOVING),
                "sound": all(sound(verdict) for verdict in own),
            }
        )
    return rows
