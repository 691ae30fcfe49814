"""Commands that sit in the interface's queue, outlive their sender and go out when the way is free.

The queue is `plug`: it holds every frame until it is told to let go, so that nothing here depends
on time. The daemon's frames go through it, the encoder's past it, as on a bus where the valve node
alone does not answer.
"""

import subprocess
import sys
import time
from pathlib import Path

import can
import pytest
from interface_queue import INTERFACE, ip_link, plug, second_band, witness
from joint_thread import BUS_OFF, RESTARTED, JointThread
from toy_operator import LIMIT_S, arm, mode_of, slow_law, until

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
from toy_daemon import Daemon, EncoderNode

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(300)]
BARE_SENDER = """
import can, sys, time
bus = can.Bus(interface="socketcan", channel=sys.argv[1])
for i in range(20):
    bus.send(can.Message(arbitration_id=0x201, is_extended_id=False, data=[i] * 8))
print("sent", flush=True)
time.sleep(60)
"""


@pytest.fixture
def plugged():
    with second_band("plug", "limit", "4000"):
        plug("release_indefinite")
        yield
    # Whatever a test left in the interface must not meet the next one.
    ip_link("set", INTERFACE, "down")
    ip_link("set", INTERFACE, "up")


def enabled(commands: list[bytes]) -> list[bool]:
    node = EncoderNode()
    return [
        node.decode(can.Message(arbitration_id=0x201, is_extended_id=False, data=data))["Enable"]
        == 1
        for data in commands
    ]


def release_and_count(seen) -> list[bytes]:
    """The commands that leave the queue now that it opens."""
    before = len(seen.commands())
    plug("release_indefinite")
    time.sleep(1.0)
    return seen.commands()[before:]


def send_and_die() -> None:
    """Twenty commands of a sender that knows no rule, and is killed when they are handed over."""
    sender = subprocess.Popen(
        [sys.executable, "-c", BARE_SENDER, INTERFACE], stdout=subprocess.PIPE
    )
    assert sender.stdout.readline() == b"sent\n"
    sender.kill()
    sender.wait()


def test_without_the_rule_every_command_is_replayed(plugged, tmp_path):
    """What the rule is for, shown once with a sender that knows none."""
    with witness(tmp_path / "bus.log") as seen:
        plug("block")
        send_and_die()
        time.sleep(0.5)
        assert seen.commands() == []
        assert release_and_count(seen) == [bytes([i] * 8) for i in range(20)]


def test_one_command_at_most_outlives_the_daemon(plugged, tmp_path):
    """Without permission for more: the one in flight. Everything later was kept back."""
    with (
        witness(tmp_path / "bus.log") as seen,
        JointThread(),
        Daemon(tmp_path, f"socketcan:{INTERFACE}", payload=slow_law()) as daemon,
    ):
        operator = daemon.operator()
        arm(operator)
        plug("block")
        cycles = operator.ask(command="status")["counters"]["cycles"]
        daemon.status_after(cycles + 20, LIMIT_S)
        daemon.process.kill()
        daemon.process.wait()
        assert len(release_and_count(seen)) == 1


def test_no_enabled_command_outlives_a_daemon_that_may_restart_the_interface(plugged, tmp_path):
    with (
        witness(tmp_path / "bus.log") as seen,
        JointThread(),
        Daemon(
            tmp_path, f"socketcan:{INTERFACE}", "--restart-interface", payload=slow_law()
        ) as daemon,
    ):
        arm(daemon.operator())
        plug("block")
        until(lambda: "restarted, its queue is empty" in daemon.log(), daemon.log())
        time.sleep(0.5)
        daemon.process.kill()
        daemon.process.wait()
        assert not any(enabled(release_and_count(seen)))


def test_two_bus_offs_within_a_second_replay_nothing(plugged, tmp_path):
    """The kernel empties the queue of an interface that is bus-off once a second at most."""
    with (
        witness(tmp_path / "bus.log") as seen,
        JointThread() as joint,
        Daemon(
            tmp_path, f"socketcan:{INTERFACE}", "--restart-interface", payload=slow_law()
        ) as daemon,
    ):
        operator = daemon.operator()
        arm(operator)
        plug("block")
        for _ in range(2):
            joint.send_error_frame(BUS_OFF)
            joint.send_error_frame(RESTARTED)
            time.sleep(0.2)
        until(lambda: "restarted, its queue is empty" in daemon.log(), daemon.log())
        time.sleep(0.2)
        daemon.process.kill()
        daemon.process.wait()
        assert not any(enabled(release_and_count(seen)))


def test_what_an_earlier_process_left_is_purged_at_the_start(plugged, tmp_path):
    with witness(tmp_path / "bus.log") as seen:
        plug("block")
        send_and_die()
        with (
            JointThread(),
            Daemon(
                tmp_path, f"socketcan:{INTERFACE}", "--restart-interface", payload=slow_law()
            ) as daemon,
        ):
            daemon.status_after(5, LIMIT_S)
            assert not any(enabled(release_and_count(seen)))
            arm(daemon.operator())  # the probe came through


def test_arming_waits_for_the_probe_and_says_how_to_clear_the_queue(plugged, tmp_path):
    plug("block")
    with (
        JointThread(),
        Daemon(tmp_path, f"socketcan:{INTERFACE}", payload=slow_law()) as daemon,
    ):
        operator = daemon.operator()
        daemon.status_after(5, LIMIT_S)
        reply = operator.ask(command="arm")
        assert not reply["ok"]
        assert f"ip link set {INTERFACE} down" in reply["message"], reply["message"]
        assert "--restart-interface" in reply["message"]
        # Scheduled for a cycle it is refused by the cycle itself.
        cycle = operator.ask(command="status")["cycle"] + 10
        operator.ask(command="arm", at_cycle=cycle)
        daemon.status_after(cycle + 10, LIMIT_S)
        assert mode_of(operator) == "DISARMED"
        plug("release_indefinite")
        arm(operator)
