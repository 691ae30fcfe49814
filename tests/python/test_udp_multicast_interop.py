"""python-can's own udp_multicast bus against the daemon's: the same frames in both directions."""

import csv
import struct
import subprocess
import time

import can
import msgpack
import pytest
from can.interfaces.udp_multicast.utils import pack_message
from toy_daemon import (
    ARMING_RAMP_S,
    BIAS_V,
    PERIOD_S,
    UDP_PORT,
    Daemon,
    EncoderNode,
    answer,
    eampcd,
)

URL = f"udp_multicast:239.74.163.2:{UDP_PORT}"
ARM_CYCLE = 20
ARMING_CYCLES = round(ARMING_RAMP_S / PERIOD_S)


@pytest.fixture
def bus():
    with can.Bus(
        interface="udp_multicast", channel="239.74.163.2", port=UDP_PORT, hop_limit=0
    ) as bus:
        yield bus


@pytest.fixture
def lockstep(tmp_path):
    with Daemon(tmp_path, URL, "--emulation", "--lockstep") as daemon:
        yield daemon


def test_every_encoder_frame_gets_one_command(bus, lockstep):
    node = EncoderNode()
    for cycle in range(50):
        bus.send(node.frame())
        command = node.decode(answer(bus))
        assert command["Counter"] == cycle % 16
        assert (command["U1"], command["U2"], command["Enable"]) == (0.0, 0.0, 0)
    counters = lockstep.status_after(50)["counters"]
    assert counters["encoder_frames"] == counters["cycles"] == 50
    assert counters["missed_cycles"] == 0


def test_arm_at_cycle_is_exact_and_repeats(bus, tmp_path):
    commands = []
    for attempt in range(2):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        with Daemon(folder, URL, "--emulation", "--lockstep") as daemon:
            operator = daemon.operator()
            step = {"kind": "step", "amplitude_rad": 0.2, "start_s": 0.1}
            assert operator.ask(command="reference", **step)["ok"]
            reply = operator.ask(command="arm", at_cycle=ARM_CYCLE)
            assert reply["ok"], reply["message"]
            assert reply["mode"] == "INIT"
            node = EncoderNode()
            run = []
            for _ in range(100):
                bus.send(node.frame())
                run.append(bytes(answer(bus).data))
            commands.append(run)
            assert daemon.status_after(100)["mode"] == "ACTIVE"
            assert daemon.stop() == 0
            while bus.recv(0.1) is not None:  # its last, safe frame
                pass
            with daemon.record_path.open() as file:
                rows = list(csv.DictReader(file))
        assert [int(row["cycle"]) for row in rows] == list(range(100))
        modes = [row["mode"] for row in rows]
        assert modes.index("ARMING") == ARM_CYCLE
        assert modes.index("ACTIVE") == ARM_CYCLE + ARMING_CYCLES
        assert float(rows[ARM_CYCLE + ARMING_CYCLES]["scenario_time_s"]) == 0.0
        assert float(rows[-1]["reference_angle_rad"]) == 0.2
        assert {row["fault"] for row in rows} == {"none"}
    assert commands[0] == commands[1]


def test_sigterm_vents_and_sends_the_safe_frame_last(bus, lockstep):
    node = EncoderNode()
    operator = lockstep.operator()
    operator.ask(command="arm", at_cycle=5)
    for _ in range(40):
        bus.send(node.frame())
        last = node.decode(answer(bus))
    assert last["Enable"] == 1
    assert last["U1"] == pytest.approx(BIAS_V, abs=0.5)
    # The plant stops: in lock-step no cycle comes any more, the daemon must not wait for one.
    assert lockstep.stop(limit_s=10.0) == 0
    final = node.decode(answer(bus))
    assert (final["U1"], final["U2"], final["Enable"]) == (0.0, 0.0, 0)


def test_arm_is_refused_without_emulation(bus, tmp_path):
    with Daemon(tmp_path, URL) as daemon:
        node = EncoderNode()
        for _ in range(20):
            bus.send(node.frame())
            answer(bus)
        reply = daemon.operator().ask(command="arm")
        assert not reply["ok"]
        assert "--emulation" in reply["message"]
        assert daemon.stop() == 0


def test_arm_is_refused_before_the_first_frame(tmp_path):
    with Daemon(tmp_path, URL, "--emulation") as daemon:
        reply = daemon.operator().ask(command="arm")
        assert not reply["ok"]
        assert "no valid encoder frame" in reply["message"]
        assert daemon.stop() == 0


def test_operator_arms_and_disarms_in_real_time(bus, tmp_path):
    with Daemon(tmp_path, URL, "--emulation") as daemon:
        node = EncoderNode()
        notifier_end = time.monotonic() + 1.0
        operator = daemon.operator()
        asked = {}
        while time.monotonic() < notifier_end:
            bus.send(node.frame())
            answer(bus)
            left = notifier_end - time.monotonic()
            for command, at_s in (("arm", 0.8), ("disarm", 0.4)):
                if left < at_s and command not in asked:
                    body = msgpack.packb({"command": command})
                    operator.socket.sendall(struct.pack("<I", len(body)) + body)
                    asked[command] = True
            time.sleep(PERIOD_S)
        replies = []
        for _ in asked:
            (size,) = struct.unpack("<I", operator._exactly(4))
            replies.append(msgpack.unpackb(operator._exactly(size)))
        assert [reply["ok"] for reply in replies] == [True, True], replies
        assert operator.ask(command="status")["mode"] == "DISARMED"
        assert daemon.stop() == 0


def test_silence_is_noticed_and_stops(bus, tmp_path):
    with Daemon(tmp_path, URL, "--emulation") as daemon:
        node = EncoderNode()
        operator = daemon.operator()
        operator.ask(command="arm", at_cycle=5)
        for _ in range(60):
            bus.send(node.frame())
            time.sleep(PERIOD_S)
        time.sleep(0.5)
        status = operator.ask(command="status")
        assert status["mode"] == "FAULT", status
        assert "encoder" in status["fault"]
        assert status["counters"]["encoder_timeouts"] > 0
        arm = operator.ask(command="arm")
        assert not arm["ok"]
        assert "reset" in arm["message"]
        assert daemon.stop() == 0


def test_foreign_frames_do_no_harm(bus, lockstep):
    node = EncoderNode()
    bus.send(can.Message(arbitration_id=0x181, is_extended_id=True, data=bytes(8)))
    bus.send(can.Message(arbitration_id=0x181, is_extended_id=False, is_remote_frame=True, dlc=8))
    bus.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"abc"))
    bus.send(can.Message(arbitration_id=0x181, is_fd=True, is_extended_id=False, data=bytes(64)))
    for garbage in (b"", b"\xc1", b"\x8b", bytes(4000), pack_message(node.frame())[:-1]):
        bus._multicast.send(garbage)
    bus._multicast._socket.setblocking(False)
    time.sleep(0.1)
    while True:  # python-can itself raises on the garbage
        try:
            bus._multicast._socket.recv(8192)
        except BlockingIOError:
            break
    node = EncoderNode()
    bus.send(node.frame())
    assert node.decode(answer(bus))["Counter"] == 0
    assert lockstep.status_after(1)["counters"]["ignored_frames"] >= 9


def test_operator_socket_refuses_nonsense(lockstep):
    operator = lockstep.operator()
    for request, hint in (
        ({"command": "explode"}, "arm, disarm"),
        ({"command": "arm", "at_cycle": "soon"}, "at_cycle"),
        ({"command": "reference", "kind": "sine", "amplitude_rad": float("nan")}, "finite"),
        ({"command": "reference", "kind": "table", "table": b"12345"}, "table"),
        ({"command": "reference"}, "kind"),
        ({}, "command"),
        ({"command": "status", "colour": 1}, "colour"),
    ):
        reply = operator.ask(**request)
        assert not reply["ok"]
        assert hint in reply["message"]
    for body in (b"", b"\xc1", b"\x93abc", b"\xdf\xff\xff\xff\xff", b"\xdd\xff\xff\xff\xff"):
        assert not operator.ask_bytes(body)["ok"]
    # A length that no request has: the daemon says so and hangs up.
    operator.socket.sendall(b"\xff\xff\xff\xff")
    (size,) = struct.unpack("<I", operator._exactly(4))
    assert "longer" in msgpack.unpackb(operator._exactly(size))["message"]
    assert lockstep.operator().ask(command="status")["ok"]


def test_table_reference_is_followed(bus, lockstep):
    operator = lockstep.operator()
    rows = [(0.001 * k, 0.2, 0.0) for k in range(1000)]
    table = b"".join(struct.pack("<3d", *row) for row in rows)
    assert operator.ask(command="reference", kind="table", table=table, sample_period_s=PERIOD_S)[
        "ok"
    ]
    assert operator.ask(command="arm", at_cycle=0)["ok"]
    node = EncoderNode()
    for _ in range(ARMING_CYCLES + 51):
        bus.send(node.frame())
        answer(bus)
    status = lockstep.status_after(ARMING_CYCLES + 51)
    assert status["reference_angle_rad"] == pytest.approx(0.050)


def test_a_second_daemon_is_refused_the_socket(lockstep, tmp_path):
    second = subprocess.run(
        [
            eampcd(),
            f"--law={tmp_path / 'toy.law'}",
            f"--bus={URL}",
            f"--socket={lockstep.socket_path}",
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert second.returncode == 2
    assert "another eampcd listens there" in second.stderr
    assert lockstep.operator().ask(command="status")["ok"]
