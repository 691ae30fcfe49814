"""Which command frames the valve node believes."""

import can
import pytest
from eampc_rig import Frames

from plant_emulator.valve_node import (
    STATUS_REFUSED,
    STATUS_SAFE,
    STATUS_TIMED_OUT,
    ValveNode,
)


@pytest.fixture
def node(reference_frames: Frames) -> ValveNode:
    return ValveNode(reference_frames.valve_command, 0.0, 0.02)


def command(frames: Frames, u1: float, u2: float, counter: int, enable: int = 1) -> bytes:
    return frames.valve_command.encode({"u1": u1, "u2": u2, "enable": enable}, counter)


def test_safe_before_the_first_command(node: ValveNode) -> None:
    assert node.timed_out
    assert (node.u1_V, node.u2_V) == (0.0, 0.0)
    assert node.take_status() == STATUS_SAFE | STATUS_TIMED_OUT


def test_valid_command_is_applied(node: ValveNode, reference_frames: Frames) -> None:
    assert node.receive(command(reference_frames, 6.125, 3.875, 4))
    assert (node.u1_V, node.u2_V) == (6.125, 3.875)
    assert node.take_status() == 0


def test_enable_zero_means_the_safe_voltage(node: ValveNode, reference_frames: Frames) -> None:
    assert node.receive(command(reference_frames, 6.0, 4.0, 4, enable=0))
    assert (node.u1_V, node.u2_V) == (0.0, 0.0)
    assert not node.timed_out
    assert node.take_status() == STATUS_SAFE


def test_wrong_frames_are_refused_and_named(node: ValveNode, reference_frames: Frames) -> None:
    good = command(reference_frames, 6.0, 4.0, 4)
    assert node.receive(good)
    assert not node.receive(good)  # a replayed frame
    assert not node.receive(good[:7])
    damaged = bytearray(command(reference_frames, 6.0, 4.0, 5))
    damaged[0] ^= 1
    assert not node.receive(bytes(damaged))
    counts = node.counts
    assert (counts.repeated_counter, counts.wrong_length, counts.bad_crc) == (1, 1, 1)
    assert counts.accepted == 1
    assert node.take_status() == STATUS_REFUSED
    assert node.take_status() == 0


def test_counter_gap_is_counted_and_accepted(node: ValveNode, reference_frames: Frames) -> None:
    assert node.receive(command(reference_frames, 5.0, 5.0, 14))
    assert node.receive(command(reference_frames, 5.0, 5.0, 17))  # 14, then 1: 15 and 0 lost
    assert node.counts.lost == 2


def test_time_out_after_exactly_20_ms(node: ValveNode, reference_frames: Frames) -> None:
    node.receive(command(reference_frames, 6.0, 4.0, 1))
    assert node.time_left_s == pytest.approx(0.02)
    assert [node.elapse(0.005) for _ in range(4)] == [False, False, False, True]
    assert node.timed_out
    assert (node.u1_V, node.u2_V) == (0.0, 0.0)
    assert node.receive(command(reference_frames, 6.0, 4.0, 9))
    assert not node.timed_out
    assert node.counts.lost == 0  # silence is no lost frame


def test_refused_frames_do_not_hold_off_the_time_out(
    node: ValveNode, reference_frames: Frames
) -> None:
    good = command(reference_frames, 6.0, 4.0, 1)
    node.receive(good)
    for _ in range(4):
        node.elapse(0.005)
        node.receive(good)
    assert node.timed_out


def test_only_data_frames_with_its_id_are_commands(node: ValveNode) -> None:
    def message(**fields: object) -> can.Message:
        return can.Message(**{"arbitration_id": 0x201, "is_extended_id": False, **fields})

    assert node.is_command(message(data=bytes(8)))
    assert not node.is_command(message(arbitration_id=0x202))
    assert not node.is_command(message(is_extended_id=True))
    assert not node.is_command(message(is_remote_frame=True))
    assert not node.is_command(message(is_error_frame=True))
