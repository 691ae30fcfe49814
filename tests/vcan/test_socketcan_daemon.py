"""The daemon on a real SocketCAN bus: python-can as the joint, candump as the witness.

Needs vcan0 and root (tools/vcanrun gives both). Time limits are those of user-mode Linux, where a
system call costs 100 us.
"""

import re
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
from toy_daemon import BIAS_V, Daemon, EncoderNode, answer, eampcd, law_bytes, law_payload

pytestmark = pytest.mark.vcan
INTERFACE = "vcan0"
URL = f"socketcan:{INTERFACE}"


@pytest.fixture
def bus():
    with can.Bus(interface="socketcan", channel=INTERFACE) as bus:
        yield bus


@pytest.fixture
def lockstep(tmp_path):
    with Daemon(tmp_path, URL, "--emulation", "--lockstep") as daemon:
        yield daemon


def set_link(state: str) -> None:
    subprocess.run(["ip", "link", "set", INTERFACE, state], check=True)


def counters(daemon: Daemon, cycles: int) -> dict:
    return daemon.status_after(cycles)["counters"]


def test_candump_sees_the_same_bytes(bus, lockstep, tmp_path):
    log = tmp_path / "candump.log"
    with log.open("wb") as file:
        witness = subprocess.Popen(["candump", "-L", INTERFACE], stdout=file)
        try:
            time.sleep(0.5)
            node = EncoderNode()
            lockstep.operator().ask(command="arm", at_cycle=5)
            sent, received = [], []
            for _ in range(50):
                frame = node.frame()
                bus.send(frame)
                sent.append(bytes(frame.data).hex().upper())
                command = answer(bus)
                node.decode(command)
                received.append(bytes(command.data).hex().upper())
            time.sleep(0.5)
        finally:
            witness.terminate()
            witness.wait()
    seen = re.findall(r" vcan0 ([0-9A-F]+)#([0-9A-F]*)", log.read_text())
    assert [data for name, data in seen if name == "181"] == sent
    assert [data for name, data in seen if name == "201"] == received
    assert [name for name, _ in seen] == ["181", "201"] * 50
    # Every own frame came back as a transmit confirmation.
    assert counters(lockstep, 50)["confirmed_frames"] >= 49


def test_only_the_encoders_frames_start_a_cycle(bus, lockstep):
    for message in (
        can.Message(arbitration_id=0x181, is_extended_id=True, data=bytes(8)),
        can.Message(arbitration_id=0x181, is_extended_id=False, is_remote_frame=True, dlc=8),
        can.Message(arbitration_id=0x123, is_extended_id=False, data=b"abc"),
        can.Message(arbitration_id=0x201, is_extended_id=False, data=bytes(8)),
        can.Message(arbitration_id=0x004, is_error_frame=True, dlc=8, data=bytes(8)),
    ):
        bus.send(message)
    node = EncoderNode()
    bus.send(node.frame())
    answer(bus)
    found = counters(lockstep, 1)
    assert found["cycles"] == found["encoder_frames"] == 1
    assert found["error_frames"] == 1
    assert found["ignored_frames"] == 1  # the foreign command; the kernel's filter held the rest


def test_link_down_and_up_is_survived(bus, lockstep):
    node = EncoderNode()
    for _ in range(5):
        bus.send(node.frame())
        answer(bus)
    set_link("down")
    time.sleep(1.0)
    set_link("up")
    time.sleep(0.5)
    assert counters(lockstep, 5)["link_downs"] == 1
    with can.Bus(interface="socketcan", channel=INTERFACE) as again:
        for _ in range(5):
            again.send(node.frame())
            answer(again)
    assert counters(lockstep, 10)["cycles"] == 10
    assert lockstep.stop() == 0


def test_link_down_in_motion_is_a_fault_and_not_a_crash(bus, tmp_path):
    payload = law_payload()
    payload["timing"]["period_s"] = 0.02  # user-mode Linux keeps this pace
    payload["safety"]["encoder_timeout_s"] = 0.2
    with Daemon(tmp_path, URL, payload=payload) as daemon:
        operator = daemon.operator()
        node = EncoderNode()
        operator.ask(command="arm", at_cycle=10)
        for _ in range(60):
            bus.send(node.frame())
            last = node.decode(answer(bus))
            time.sleep(0.02)
        assert last["Enable"] == 1
        assert last["U1"] == pytest.approx(BIAS_V, abs=1.0)
        set_link("down")
        time.sleep(1.0)
        status = operator.ask(command="status")
        set_link("up")
        assert status["mode"] == "FAULT", status
        assert status["counters"]["send_errors"] > 0
        assert daemon.stop() == 0


def test_sigterm_sends_the_safe_frame_last(bus, lockstep):
    node = EncoderNode()
    lockstep.operator().ask(command="arm", at_cycle=2)
    for _ in range(30):
        bus.send(node.frame())
        answer(bus)
    assert lockstep.stop() == 0
    final = node.decode(answer(bus))
    assert (final["U1"], final["U2"], final["Enable"]) == (0.0, 0.0, 0)


def test_missing_and_downed_interface(tmp_path):
    law = tmp_path / "toy.law"
    law.write_bytes(law_bytes())

    def refusal(interface: str) -> str:
        result = subprocess.run(
            [eampcd(), f"--law={law}", f"--bus=socketcan:{interface}"],
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert result.returncode == 2, result.stderr
        return result.stderr

    assert "cannot open CAN interface can9: no such device" in refusal("can9")
    assert "not a CAN interface" in refusal("lo")
    set_link("down")
    try:
        assert f"ip link set {INTERFACE} up" in refusal(INTERFACE)
    finally:
        set_link("up")
