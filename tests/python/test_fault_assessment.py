"""The judge of faulted runs, on records made by hand: right ones pass, wrong ones are told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from eampc.errors import UserError
from eampc.hil.fault_assessment import FaultVerdict, judge_fault, judge_wire
from eampc.hil.fault_plan import PlannedFault, plan_faults, read_faults
from eampc.hil.recording import Recording
from eampc.hil.stop_on_the_wire import stop_frames
from eampc_rig import Rig, RigError, load_rig
from eampc_rig.fault_catalogue import CATALOGUE, catalogue_entry, parse_timed_fault

REFERENCE = Path(__file__).parents[2] / "rigs" / "reference"
# Ramps of 4 periods of 5 ms; bias 5 V, safe 0 V; at most 1.5 V per period.
OVERRIDES = {"safety.soft_stop_ramp_s": 0.02, "valve.slew_max_V_per_s": 300.0}
UDP = "udp_multicast:239.74.163.2:43113"
E_STOP, CRC = 19, 2  # numbers of control::Fault


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(REFERENCE, overrides=OVERRIDES)


def test_soft_stop_by_hand(rig: Rig) -> None:
    """From (7, 3) V: to 5 V in 4 periods, to 0 V in 4, then disabled."""
    rows = stop_frames(rig, (7.0, 3.0), {0: "soft_stop"}, 10, False)
    u1 = [6.5, 6.0, 5.5, 5.0, 3.75, 2.5, 1.25, 0.0, 0.0, 0.0]
    u2 = [3.5, 4.0, 4.5, 5.0, 3.75, 2.5, 1.25, 0.0, 0.0, 0.0]
    assert rows[:, 0] == pytest.approx(u1)
    assert rows[:, 1] == pytest.approx(u2)
    assert rows[:, 2].tolist() == [1] * 8 + [0] * 2


def test_saturate_holds_first(rig: Rig) -> None:
    rows = stop_frames(rig, (7.0, 3.0), {0: "saturate"}, 14, False)
    assert rows[:4, 0].tolist() == [7.0] * 4
    assert rows[4:8, 0] == pytest.approx([6.5, 6.0, 5.5, 5.0])
    assert rows[11, 2] == 1
    assert rows[12, 2] == 0


def test_vent_ramp_cuts_into_a_soft_stop_and_not_the_other_way_round(rig: Rig) -> None:
    rows = stop_frames(rig, (7.0, 3.0), {0: "soft_stop", 2: "vent_ramp", 3: "saturate"}, 8, False)
    assert rows[:, 0] == pytest.approx([6.5, 6.0, 4.5, 3.0, 1.5, 0.0, 0.0, 0.0])
    assert rows[:, 2].tolist() == [1] * 6 + [0] * 2


def test_immediate_is_safe_in_its_own_frame(rig: Rig) -> None:
    rows = stop_frames(rig, (7.0, 3.0), {0: "soft_stop", 1: "immediate"}, 3, False)
    assert rows[1].tolist() == [0.0, 0.0, 0.0]


def test_soft_stop_below_the_bias_goes_straight_down(rig: Rig) -> None:
    rows = stop_frames(rig, (2.0, 2.0), {0: "soft_stop"}, 4, True)
    assert rows[:, 0] == pytest.approx([1.5, 1.0, 0.5, 0.0])


def run_with_stop(rig: Rig, count: int = 60, at: int = 20) -> tuple[dict[str, Any], dict[str, Any]]:
    """Record and commands of a joint at (6, 4) V that an E-stop ends in frame `at`."""
    frames = np.arange(count, dtype=float)
    stopped = frames >= at
    u1 = np.where(stopped, 0.0, 6.0)
    u2 = np.where(stopped, 0.0, 4.0)
    record = {
        "cycle": frames,
        "u1_V": u1,
        "u2_V": u2,
        "region": np.where(stopped, -1.0, 3.0),
        "mode": np.where(stopped, "FAULT", "ACTIVE").astype(object),
        "fault": np.where(stopped, "e_stop", "none").astype(object),
        "present_faults": np.where((frames >= at) & (frames < at + 4), float(1 << E_STOP), 0.0),
    }
    commands = {
        "frame": frames.copy(),
        "offset_s": np.zeros(count),
        "valid": np.ones(count),
        "u1_V": u1.copy(),
        "u2_V": u2.copy(),
        "enable": np.where(stopped, 0.0, 1.0),
        "counter": frames % 16,
    }
    return record, commands


def verdict_on(rig: Rig, record: dict[str, Any], commands: dict[str, Any]) -> FaultVerdict:
    fault = PlannedFault(catalogue_entry("e_stop"), 20, 24, "e_stop", "immediate", 1)
    return judge_fault(rig, fault, Recording(record), Recording(commands), lockstep=True)


def test_immediate_stop_passes(rig: Rig) -> None:
    verdict = verdict_on(rig, *run_with_stop(rig))
    assert verdict == FaultVerdict("e_stop", "e_stop", "ACTIVE", 1, 1, "immediate", 0.0, True)


def test_late_detection_is_counted(rig: Rig) -> None:
    assert verdict_on(rig, *run_with_stop(rig, at=22)).detected_cycles == 3


def test_fault_that_nobody_saw(rig: Rig) -> None:
    verdict = verdict_on(rig, *run_with_stop(rig, at=100))
    assert verdict.detected_cycles is None
    assert not verdict.latched


def test_wrong_voltage_or_enable_bit_is_told(rig: Rig) -> None:
    record, commands = run_with_stop(rig)
    commands["u1_V"][30] = 0.25
    assert verdict_on(rig, record, commands).deviation_V == pytest.approx(0.25)
    commands["enable"][40] = 1.0
    assert verdict_on(rig, record, commands).deviation_V == np.inf


def test_another_fault_in_the_latch_is_told(rig: Rig) -> None:
    record, commands = run_with_stop(rig)
    record["fault"][35] = "encoder_crc"
    assert not verdict_on(rig, record, commands).latched


def test_wire_counts(rig: Rig) -> None:
    _, commands = run_with_stop(rig)
    clean = judge_wire(rig, Recording(commands), [0])
    assert (clean.voltage_violations, clean.slew_violations, clean.automatic_resumes) == (0, 0, 0)
    assert judge_wire(rig, Recording(commands), []).automatic_resumes == 1
    commands["u1_V"][5] = 10.5  # beyond 10 V, and two steps of more than 1.5 V
    commands["u2_V"][50] = 0.5  # disabled, and not the safe voltage
    commands["enable"][55] = 1.0  # a resume that nobody ordered
    commands["valid"][12] = 0.0
    wrong = judge_wire(rig, Recording(commands), [0])
    assert wrong.voltage_violations == 2
    assert wrong.slew_violations == 2
    assert wrong.automatic_resumes == 1
    assert wrong.invalid_frames == 1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("e_stopp@1", "did you mean e_stop"),
        ("e_stop", "write NAME@SECONDS"),
        ("e_stop@x", "write NAME@SECONDS"),
        ("e_stop@2..1", "the end must come after the start"),
        ("e_stop@1..inf", "write NAME@SECONDS"),
    ],
)
def test_wrong_fault_texts_are_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(RigError, match=sentence) as caught:
        parse_timed_fault(text)
    assert "\n" not in str(caught.value)


def test_faults_are_placed_on_frames(rig: Rig) -> None:
    faults = read_faults(["encoder_crc@0.5..0.6", "e_stop@-0.1"], rig, UDP, lockstep=True)
    first, second = plan_faults(faults, rig, 160, lockstep=True)
    assert (first.entry.name, first.first, first.action) == ("e_stop", 140, "immediate")
    assert (second.first, second.end, second.limit) == (260, 280, 3)
    assert second.emulator_argument == "encoder_crc@260:20"
    with pytest.raises(UserError, match=r"before the run's first frame"):
        plan_faults(read_faults(["e_stop@-1"], rig, UDP, True), rig, 160, True)


@pytest.mark.parametrize(
    ("name", "lockstep", "sentence"),
    [
        ("link_down", False, "udp_multicast has no CAN controller"),
        ("bus_off", True, "udp_multicast has no CAN controller"),
        ("deadline_overruns", True, "lock-step has no deadlines"),
        ("law_mismatch", True, "has no bus.identity"),
    ],
)
def test_fault_that_cannot_be_had_says_why(
    rig: Rig, name: str, lockstep: bool, sentence: str
) -> None:
    with pytest.raises(UserError, match=sentence):
        read_faults([f"{name}@1"], rig, UDP, lockstep)


def test_every_fault_of_the_daemon_but_one_can_be_had() -> None:
    """not_finite has no cause outside the daemon: law and estimator would have to be broken."""
    from eampc_rig import FAULT_NAMES

    assert {entry.raises for entry in CATALOGUE} == set(FAULT_NAMES) - {"not_finite"}
