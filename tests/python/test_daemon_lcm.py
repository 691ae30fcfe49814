"""What the daemon publishes on LCM, read with the Python types; references that come in by LCM."""

import time

import can
import lcm
import pytest
from eampc_lcm import health_t, reference_t, state_t
from toy_daemon import ARMING_RAMP_S, PERIOD_S, UDP_PORT, Daemon, EncoderNode, answer, law_payload

URL = f"udp_multicast:239.74.163.2:{UDP_PORT}"
# Not LCM's default port: a run beside the tests must not be heard.
LCM_URL = f"udpm://239.255.76.67:{UDP_PORT + 1}?ttl=0"
ARMING_CYCLES = round(ARMING_RAMP_S / PERIOD_S)


@pytest.fixture
def bus():
    with can.Bus(
        interface="udp_multicast", channel="239.74.163.2", port=UDP_PORT, hop_limit=0
    ) as bus:
        yield bus


class Listener:
    def __init__(self) -> None:
        self.lcm = lcm.LCM(LCM_URL)
        self.states, self.healths = [], []
        self.lcm.subscribe("EAMPC_STATE", lambda _, data: self.states.append(state_t.decode(data)))
        self.lcm.subscribe(
            "EAMPC_HEALTH", lambda _, data: self.healths.append(health_t.decode(data))
        )

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.lcm.handle_timeout(max(1, int(1000 * left)))


def test_state_per_decimated_cycle_and_health(bus, tmp_path):
    listener = Listener()
    node = EncoderNode()
    payload = law_payload(state_decimation=2)
    arguments = ("--emulation", "--lockstep", f"--lcm-url={LCM_URL}")
    with Daemon(tmp_path, URL, *arguments, payload=payload) as daemon:
        for _ in range(40):
            bus.send(node.frame(angle_rad=0.25))
            answer(bus)
        daemon.status_after(40)
        listener.listen(1.5)
        assert daemon.stop() == 0
    assert [state.cycle for state in listener.states] == list(range(0, 40, 2))
    last = listener.states[-1]
    assert last.mode_text == "DISARMED"
    assert last.fault_text == "none"
    assert last.measured_angle_rad == pytest.approx(0.25, abs=1e-4)
    assert abs(last.utime / 1e6 - time.time()) < 60.0
    assert last.arrival_to_sent_us == pytest.approx(
        last.arrival_to_wake_us + last.wake_to_decided_us + last.decided_to_sent_us, abs=0.01
    )
    health = listener.healths[-1]
    assert health.rig_name == "toy"
    assert health.law_sha256 == "ab" * 32
    assert health.bus == URL
    assert health.cycles == health.encoder_frames == 40
    assert health.missed_cycles == 0


@pytest.mark.parametrize("allowed", [True, False])
def test_reference_by_lcm_only_if_the_law_says_so(bus, tmp_path, allowed):
    sender = lcm.LCM(LCM_URL)
    node = EncoderNode()
    payload = law_payload(reference_by_lcm=allowed)
    arguments = ("--emulation", "--lockstep", f"--lcm-url={LCM_URL}")
    with Daemon(tmp_path, URL, *arguments, payload=payload) as daemon:
        assert daemon.operator().ask(command="arm", at_cycle=0)["ok"]
        seen = 0.0
        for cycle in range(400):
            sample = reference_t()
            sample.utime = int(1e6 * time.time())
            sample.angle_rad = 5.0  # clamped to the rig's 1 rad
            sender.publish("EAMPC_REFERENCE", sample.encode())
            bus.send(node.frame())
            answer(bus)
            status = daemon.status_after(cycle + 1)
            seen = status["reference_angle_rad"]
            if allowed and seen != 0.0:
                break
            if not allowed and cycle == 60:
                break
        assert seen == (1.0 if allowed else 0.0)
