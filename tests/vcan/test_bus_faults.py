"""What a bus and its neighbours can do to the daemon in ACTIVE, on a real vcan0.

Every case: the daemon stops for the stated cause, stays stopped, and works again after the cause is
gone and the operator has reset and armed it; or it goes on, where nothing was wrong.
"""

import random
import signal
import subprocess
import sys
from pathlib import Path

import can
import pytest
from interface_queue import INTERFACE, plug, second_band, witness
from joint_thread import BUS_OFF, CONTROLLER, NO_ACK, RESTARTED, JointThread
from toy_operator import LIMIT_S, arm, fault, mode_of, reset_and_arm, slow_law, until

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
from toy_daemon import Daemon, EncoderNode

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(300)]
# Numbers of the causes (daemon/control/fault.hpp): published, so they may not change.
BUS_OFF_FAULT, PASSIVE_FAULT, UNCONFIRMED_FAULT, REFUSED_FAULT = 10, 11, 12, 14
PASSIVE = bytes([0, 0x20, 0, 0, 0, 0, 136, 0])  # linux/can/error.h: TX_PASSIVE, counters
ACTIVE_AGAIN = bytes([0, 0x40, 0, 0, 0, 0, 90, 0])


@pytest.fixture
def joint():
    with JointThread() as joint:
        yield joint


@pytest.fixture
def daemon(joint, tmp_path):
    with Daemon(tmp_path, f"socketcan:{INTERFACE}", payload=slow_law()) as daemon:
        arm(daemon.operator())
        yield daemon


def status(daemon: Daemon) -> dict:
    return daemon.operator().ask(command="status")


def run_on(daemon: Daemon, cycles: int) -> dict:
    return daemon.status_after(status(daemon)["counters"]["cycles"] + cycles, LIMIT_S)


def fill_band() -> None:
    """Until the interface takes no more; some of it may be the daemon's."""
    with can.Bus(interface="socketcan", channel=INTERFACE) as stranger:
        for _ in range(10):
            try:
                stranger.send(can.Message(arbitration_id=0x7F0, is_extended_id=False, data=b"x"))
            except can.CanOperationError:
                return
    raise AssertionError("the queue does not fill up")


def decoded(commands: list[bytes]) -> list[dict]:
    node = EncoderNode()
    return [
        node.decode(can.Message(arbitration_id=0x201, is_extended_id=False, data=data))
        for data in commands
    ]


def enabled(commands: list[bytes]) -> list[bool]:
    return [values["Enable"] == 1 for values in decoded(commands)]


def voltages(commands: list[bytes]) -> list[float]:
    return [values[name] for values in decoded(commands) for name in ("U1", "U2")]


def test_bus_off_stops_until_the_controller_is_back(joint, daemon):
    joint.send_error_frame(BUS_OFF)
    assert fault(daemon) == BUS_OFF_FAULT
    assert "bus-off" in daemon.log()
    joint.send_error_frame(RESTARTED)
    reset_and_arm(daemon.operator())


def test_error_passive_stops_while_it_lasts(joint, daemon):
    joint.send_error_frame(CONTROLLER, PASSIVE)
    assert fault(daemon) == PASSIVE_FAULT
    assert "error passive, counters 136 sending and 0 receiving" in daemon.log()
    operator = daemon.operator()
    operator.ask(command="reset")
    assert not operator.ask(command="arm")["ok"]
    joint.send_error_frame(CONTROLLER, ACTIVE_AGAIN)
    reset_and_arm(operator)


def test_a_single_missing_acknowledgement_is_told_and_no_fault(joint, daemon):
    before = status(daemon)["counters"]["error_frames"]
    joint.send_error_frame(NO_ACK)
    after = run_on(daemon, 10)
    assert after["mode"] == "ACTIVE"
    assert after["counters"]["error_frames"] == before + 1
    assert "not acknowledged" in daemon.log()


def test_an_unconfirmed_command_stops_and_the_newest_one_follows_it(joint, daemon, tmp_path):
    with witness(tmp_path / "bus.log") as seen, second_band("plug", "limit", "4000"):
        assert fault(daemon) == UNCONFIRMED_FAULT  # a new plug is shut
        plug("release_indefinite")
        reset_and_arm(daemon.operator())
        plug("block")
        assert fault(daemon) == UNCONFIRMED_FAULT
        before = len(seen.commands())
        plug("release_indefinite")
        run_on(daemon, 10)
        until(lambda: len(seen.commands()) >= before + 3, "no command comes after the first")
        # The one that waited still has the law's voltages; everything after it says stop.
        waited, *later = enabled(seen.commands()[before:])
        assert waited
        assert not any(later)
        reset_and_arm(daemon.operator())


@pytest.mark.parametrize(
    "kind",
    [
        ["plug", "limit", "8"],  # a frame has 16 bytes
        ["netem", "delay", "200s", "limit", "1"],
        ["tbf", "rate", "8bit", "burst", "16", "limit", "16"],
    ],
    ids=lambda kind: kind[0],
)
def test_a_full_queue_stops_and_is_no_wait(joint, daemon, kind):
    with second_band(*kind):
        fill_band()
        assert fault(daemon) in (REFUSED_FAULT, UNCONFIRMED_FAULT)
    reset_and_arm(daemon.operator())


def test_look_alikes_start_no_cycle_and_harm_nothing(joint, daemon):
    for _ in range(20):
        for name in (0x181, 0x182, 0x201):
            joint.send(can.Message(arbitration_id=name, is_extended_id=True, data=bytes(8)))
            joint.send(
                can.Message(arbitration_id=name, is_extended_id=False, is_remote_frame=True, dlc=8)
            )
    found = run_on(daemon, 20)
    assert found["mode"] == "ACTIVE"
    assert found["counters"]["invalid_frames"] == 0
    assert found["counters"]["ignored_frames"] == 0  # the kernel's filter holds them


def test_somebody_elses_commands_are_told(joint, daemon):
    joint.send(can.Message(arbitration_id=0x201, is_extended_id=False, data=bytes(8)))
    until(lambda: "another program or node sends our command" in daemon.log(), daemon.log())
    assert run_on(daemon, 10)["mode"] == "ACTIVE"


def test_frames_lost_before_they_were_read_are_counted(joint, daemon):
    node = EncoderNode()
    daemon.process.send_signal(signal.SIGSTOP)
    # The kernel charges some 800 bytes per frame against 212,992: room for some 270.
    for _ in range(800):
        joint.send(node.frame())
    daemon.process.send_signal(signal.SIGCONT)
    assert run_on(daemon, 20)["counters"]["receive_overflows"] > 0
    assert daemon.stop() == 0


def test_a_flood_at_full_rate_leaves_the_voltages_alone(joint, daemon, tmp_path):
    with witness(tmp_path / "bus.log") as seen:
        before = status(daemon)["counters"]["ignored_frames"]
        flood = subprocess.Popen(["cangen", INTERFACE, "-g", "0", "-I", "123", "-i", "-n", "20000"])
        assert flood.wait(LIMIT_S) == 0
        found = run_on(daemon, 20)
        assert found["counters"]["ignored_frames"] == before
    all_V = voltages(seen.commands())
    assert all_V
    assert 0.0 <= min(all_V) <= max(all_V) <= 10.0
    operator = daemon.operator()
    if mode_of(operator) != "ACTIVE":  # one processor: the flood may starve the encoder
        until(lambda: mode_of(operator) == "FAULT", "neither ACTIVE nor stopped")
        reset_and_arm(operator)


def test_forged_encoder_frames_never_leave_the_limits(joint, daemon, tmp_path):
    """Some with a right checksum and any position, some of pure noise, as fast as they go."""
    noise = random.Random(4)
    node = EncoderNode()
    with witness(tmp_path / "bus.log") as seen:
        for _ in range(3000):
            forged = node.frame(noise.uniform(-1.5, 1.5), noise.uniform(-10.0, 10.0))
            if noise.random() < 0.5:
                forged.data[noise.randrange(8)] ^= 1 << noise.randrange(8)
            if noise.random() < 0.1:
                forged.data, forged.dlc = bytes(forged.data[:4]), 4
            joint.send(forged)
        found = run_on(daemon, 20)
    all_V = voltages(seen.commands())
    assert all_V
    assert 0.0 <= min(all_V) <= max(all_V) <= 10.0
    assert found["mode"] in ("ACTIVE", "SOFT_STOP", "FAULT")
    operator = daemon.operator()
    if found["mode"] != "ACTIVE":
        until(lambda: mode_of(operator) == "FAULT", "the stop does not end")
        reset_and_arm(operator)
