"""The emulator as a process on a bus, a python-can client playing the daemon.

Every test runs on udp_multicast; those marked vcan run the same on SocketCAN.
"""

import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from eampc_rig import Frames, Rig, load_rig, open_bus

RIG = Path(__file__).parents[2] / "rigs" / "reference"
T = 0.005
START_LIMIT_S = 60.0  # a user-mode Linux beside other work takes seconds to import python-can
ENCODER, FEEDBACK, COMMAND, HEARTBEAT = 0x181, 0x182, 0x201, 0x701
E_STOP, EMERGENCY = 0x010, 0x081


@pytest.fixture
def multicast_url() -> str:
    """A port of its own, so that tests side by side do not hear each other."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return f"udp_multicast:239.74.163.2:{probe.getsockname()[1]}"


@pytest.fixture(params=["multicast", pytest.param("vcan0", marks=pytest.mark.vcan)])
def url(request: pytest.FixtureRequest) -> str:
    if request.param == "multicast":
        return request.getfixturevalue("multicast_url")
    return "socketcan:vcan0"


class PretendDaemon:
    """Answers encoder frames with a hand-made law and keeps what was on the bus."""

    def __init__(self, url: str, frames: Frames) -> None:
        self.bus = open_bus(url)
        self.frames = frames
        self.seen: list[tuple[int, bytes]] = []
        self.counter = 0
        self.enable = 1

    def hear(self, timeout_s: float = START_LIMIT_S) -> can.Message | None:
        """Return the next frame of somebody else; None after `timeout_s` of silence."""
        while True:
            try:
                message = self.bus.recv(timeout_s)
            except can.CanOperationError:  # rubbish sent by a test
                continue
            if message is None:
                return None
            if message.arbitration_id != COMMAND:  # udp_multicast brings our own back
                self.seen.append((message.arbitration_id, bytes(message.data)))
                return message

    def answer(self, encoder_data: bytes) -> None:
        said = self.frames.encoder.decode(encoder_data).values
        u = max(-11.0, min(11.0, 8.0 * (0.3 - said["angle"]) - 0.5 * said["velocity"]))
        self.command(5.0 + 0.45 * u, 5.0 - 0.45 * u)

    def command(self, u1_V: float, u2_V: float) -> None:
        codec = self.frames.valve_command
        values = {"u1": u1_V, "u2": u2_V, "enable": self.enable}
        data = codec.encode(values, self.counter)
        self.counter += 1
        self.seen.append((codec.frame_id, data))
        self.bus.send(can.Message(arbitration_id=codec.frame_id, is_extended_id=False, data=data))

    def answer_until(self, frames: int, also: Callable[[int], bool] = lambda _: True) -> None:
        answered = 0
        while answered < frames:
            message = self.hear()
            assert message is not None, f"silence after {answered} frames"
            if message.arbitration_id == ENCODER:
                if also(answered):
                    self.answer(bytes(message.data))
                answered += 1

    def encoder_frames(self) -> list[bytes]:
        return [data for number, data in self.seen if number == ENCODER]


@pytest.fixture
def daemon(url: str, reference_frames: Frames) -> Iterator[PretendDaemon]:
    pretend = PretendDaemon(url, reference_frames)
    yield pretend
    pretend.bus.shutdown()


def start(url: str, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "plant_emulator", str(RIG), "--bus", url]
    return subprocess.Popen(
        [*command, "--lcm-url", "none", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str], code: int = 0) -> tuple[str, str]:
    out, err = process.communicate(timeout=START_LIMIT_S)
    assert process.returncode == code, err
    return out, err


def lockstep_run(url: str, frames_of_rig: Frames, frames: int, *options: str) -> PretendDaemon:
    pretend = PretendDaemon(url, frames_of_rig)
    try:
        process = start(url, "--lockstep", "--frames", str(frames), *options)
        pretend.answer_until(frames)
        finish(process)
    finally:
        pretend.bus.shutdown()
    return pretend


def test_lockstep_runs_are_byte_identical(url: str, reference_frames: Frames) -> None:
    options = ("--scenario", "step", "--set", "emulator.encoder_noise_rad=0.001")
    first = lockstep_run(url, reference_frames, 300, *options)
    second = lockstep_run(url, reference_frames, 300, *options)
    assert first.seen == second.seen
    other = lockstep_run(url, reference_frames, 300, *options, "--set", "emulator.seed=2")
    assert other.seen != first.seen


def test_order_and_contents_of_frames(url: str, reference_frames: Frames) -> None:
    pretend = lockstep_run(url, reference_frames, 41)
    ids = [number for number, _ in pretend.seen]
    first_period = [E_STOP, HEARTBEAT, FEEDBACK, ENCODER, COMMAND]
    assert ids[:8] == [*first_period, FEEDBACK, ENCODER, COMMAND]
    assert ids.count(HEARTBEAT) == ids.count(E_STOP) == 3  # frames 0, 20, 40: every 0.1 s
    assert EMERGENCY not in ids
    said = [reference_frames.encoder.decode(data) for data in pretend.encoder_frames()]
    assert all(frame.valid for frame in said)
    assert [frame.counter for frame in said] == [frame % 16 for frame in range(41)]
    feedback = reference_frames.valve_feedback
    assert feedback is not None
    told = [feedback.decode(data).values for number, data in pretend.seen if number == FEEDBACK]
    assert told[0] == {
        "pressure1": 0.0,
        "pressure2": 0.0,
        "supply_pressure": 1000.0,
        "status": 3.0,
    }
    assert told[1]["status"] == 0.0
    # One period of the 30 ms valve from rest towards 0.09 MPa/V times about 6.08 V.
    u = 8.0 * 0.3
    target_kPa = 90.0 * round(5.0 + 0.45 * u, 3)
    assert told[1]["pressure1"] == pytest.approx(target_kPa * (1 - np.exp(-1 / 6)), abs=0.06)


def test_lockstep_without_a_daemon_is_exit_1(url: str) -> None:
    _, err = finish(start(url, "--lockstep"), code=1)
    assert err.startswith("plant_emulator: no valve command answered encoder frame 0 within 5 s")
    assert err.count("\n") == 1


def test_truth_log_holds_until_the_lead_is_over(
    url: str, reference_frames: Frames, tmp_path: Path
) -> None:
    log = tmp_path / "truth.npz"
    hold = ("--set", "emulator.hold_until_start=true", "--set", "emulator.initial_angle_rad=0.1")
    options = ("--lead-frames", "30", "--scenario", "load", *hold, "--log", str(log))
    lockstep_run(url, reference_frames, 60, *options)
    with np.load(log) as truth:
        assert truth["frame"].tolist() == list(range(60))
        assert truth["scenario_time_s"][30] == 0.0
        assert truth["scenario_time_s"][0] == pytest.approx(-0.15)
        assert np.all(truth["angle_rad"][:31] == 0.1)
        assert truth["angle_rad"][33] != 0.1
        assert np.all(truth["answered_monotonic_s"] > truth["sent_monotonic_s"])
        assert not truth["valve_node_safe"].any()
        assert truth["u1_V"] + truth["u2_V"] == pytest.approx(10.0, abs=0.0011)


@pytest.mark.parametrize(
    ("fault", "encoder_frames"),
    [("drop@5:2", 28), ("duplicate@5:3", 33), ("delay@5:2:0.012", 30), ("stop@25", 25)],
)
def test_faults_in_lockstep_answer_for_answer(
    url: str, reference_frames: Frames, fault: str, encoder_frames: int
) -> None:
    pretend = PretendDaemon(url, reference_frames)
    process = start(url, "--lockstep", "--frames", "30", "--fault", fault)
    pretend.answer_until(encoder_frames)
    out, _ = finish(process)
    pretend.bus.shutdown()
    assert f"30 frames, 0 overruns, {encoder_frames} commands accepted, 0 refused" in out
    counters = [reference_frames.encoder.decode(d).counter for d in pretend.encoder_frames()]
    expected = {
        "drop@5:2": [4, 7, 8, 9],
        "duplicate@5:3": [4, 5, 5, 6],
        "delay@5:2:0.012": [4, 5, 7, 6],  # 12 ms are two periods: 5 comes with 7, 6 with 8
        "stop@25": [4, 5, 6, 7],
    }
    assert counters[4:8] == expected[fault]


def test_corrupt_frame_has_a_wrong_crc(url: str, reference_frames: Frames) -> None:
    pretend = lockstep_run(url, reference_frames, 10, "--fault", "corrupt@5::3")
    valid = [reference_frames.encoder.decode(data).valid for data in pretend.encoder_frames()]
    assert valid == [True] * 5 + [False] + [True] * 4


def test_dropped_answers_let_the_valve_node_time_out(
    url: str, reference_frames: Frames, tmp_path: Path
) -> None:
    """Frames 10..15 are not sent, so no command comes: safe from 20 ms after the last one on."""
    log = tmp_path / "truth.npz"
    pretend = PretendDaemon(url, reference_frames)
    options = ("--lockstep", "--frames", "20", "--fault", "drop@10:6", "--log", str(log))
    process = start(url, *options)
    pretend.answer_until(14)
    finish(process)
    pretend.bus.shutdown()
    with np.load(log) as truth:
        # The command that answered frame 9 at 45 ms lasts until 65 ms, the instant of frame 13.
        assert truth["valve_node_safe"].tolist() == [0] * 13 + [1] * 3 + [0] * 4
        assert truth["u1_V"][13] == 0.0
        assert truth["u1_V"][12] > 1.0


def test_real_time_keeps_its_grid(url: str, daemon: PretendDaemon, tmp_path: Path) -> None:
    """40 ms leave room for user-mode Linux; the grid is the same arithmetic at any period."""
    log = tmp_path / "truth.npz"
    period_s, frames = 0.04, 50
    slow = {
        "control.period_s": period_s,
        "estimator.low_pass_hz": 5,
        "safety.encoder_timeout_s": 0.1,
        "emulator.valve_timeout_s": 0.1,
    }
    options = [part for key, value in slow.items() for part in ("--set", f"{key}={value}")]
    process = start(url, *options, "--frames", str(frames), "--log", str(log))
    daemon.answer_until(frames)
    out, _ = finish(process)
    overruns = int(re.search(r"(\d+) overruns", out)[1])
    with np.load(log) as truth:
        behind = truth["sent_monotonic_s"] - period_s * np.arange(frames)
        late = behind - behind.min()
    # No drift: lateness does not add up over two seconds, whatever else the machine does.
    assert np.median(late[-25:]) < 0.25 * period_s
    assert overruns <= frames // 2


def test_real_time_sends_on_without_a_daemon(url: str, daemon: PretendDaemon) -> None:
    process = start(url, "--frames", "50")
    out, _ = finish(process)
    assert "50 frames" in out
    assert "0 commands accepted" in out
    while daemon.hear(0.2) is not None:
        pass
    assert len(daemon.encoder_frames()) == 50


def test_real_time_refuses_repeated_commands(url: str, daemon: PretendDaemon) -> None:
    process = start(url, "--frames", "40")

    def answer_once_then_repeat(frame: int) -> bool:
        daemon.counter = 7
        return True

    daemon.answer_until(40, answer_once_then_repeat)
    out, _ = finish(process)
    accepted = int(re.search(r"(\d+) commands accepted", out)[1])
    refused = int(re.search(r"(\d+) refused", out)[1])
    assert accepted == 1
    assert refused >= 30


def test_sigterm_ends_a_run_orderly(url: str, daemon: PretendDaemon, tmp_path: Path) -> None:
    log = tmp_path / "truth.csv"
    process = start(url, "--log", str(log))
    daemon.answer_until(20)
    process.send_signal(signal.SIGTERM)
    finish(process)
    assert len(log.read_text().splitlines()) >= 20


def send_rubbish(url: str) -> None:
    """A datagram that is no CAN frame; SocketCAN has no such thing."""
    if url.startswith("udp_multicast:"):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            _, group, port = url.split(":")
            stranger.sendto(b"no CAN frame", (group, int(port)))


def test_foreign_traffic_is_not_an_answer(url: str, reference_frames: Frames) -> None:
    pretend = PretendDaemon(url, reference_frames)
    process = start(url, "--lockstep", "--frames", "3")
    for _ in range(3):
        while (message := pretend.hear()) is not None and message.arbitration_id != ENCODER:
            pass
        assert message is not None
        for noise in (
            can.Message(arbitration_id=COMMAND, is_extended_id=True, data=bytes(8)),
            can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(8)),
        ):
            pretend.bus.send(noise)
        send_rubbish(url)
        time.sleep(0.02)
        pretend.answer(bytes(message.data))
    out, _ = finish(process)
    pretend.bus.shutdown()
    assert "3 frames, 0 overruns, 3 commands accepted, 0 refused" in out


def test_open_bus_keeps_to_this_machine(multicast_url: str) -> None:
    bus = open_bus(multicast_url)
    with socket.socket(fileno=socket.dup(bus.fileno())) as shared:
        assert shared.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
    bus.shutdown()


def test_stock_python_can_tools_hear_the_bus(multicast_url: str) -> None:
    """A plain python-can bus, not opened by our code, sees and is seen."""
    port = int(multicast_url.rsplit(":", 1)[1])
    stock = can.Bus(interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0)
    ours = open_bus(multicast_url)
    ours.send(can.Message(arbitration_id=1, is_extended_id=False, data=b"a"))
    heard = stock.recv(2.0)
    stock.send(can.Message(arbitration_id=2, is_extended_id=False, data=b"b"))
    ids = [message.arbitration_id for message in iter(lambda: ours.recv(0.5), None)]
    stock.shutdown()
    ours.shutdown()
    assert heard is not None
    assert heard.arbitration_id == 1
    assert ids.count(1) <= 1
    assert ids.count(2) == 1


def test_rig_by_folder_and_by_file_is_the_same(reference_rig: Rig) -> None:
    assert load_rig(RIG / "rig.toml").inputs_sha256 == reference_rig.inputs_sha256


def test_sync_trigger_gives_one_encoder_frame_per_sync(url: str, daemon: PretendDaemon) -> None:
    process = start(url, "--frames", "20", "--set", "control.trigger=sync")
    assert process.stdout is not None
    assert "paced by Sync" in process.stdout.readline()
    assert daemon.hear(0.3) is None  # nobody asked
    sync = daemon.frames.sync
    assert sync is not None
    for number in range(20):
        data = sync.encode({"counter": number})
        daemon.bus.send(can.Message(arbitration_id=0x80, is_extended_id=False, data=data))
        while len(daemon.encoder_frames()) <= number:
            message = daemon.hear()
            assert message is not None, f"no answer to Sync {number}"
            if message.arbitration_id == ENCODER:
                daemon.answer(bytes(message.data))
        assert len(daemon.encoder_frames()) == number + 1
    out, _ = finish(process)
    assert "20 frames" in out
    assert "20 commands accepted" in out
