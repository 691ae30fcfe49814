"""`eampc check`: the interface judged from what ip and tc print, the traffic from a bus."""

import copy
import json
import struct
import subprocess
import threading
from collections.abc import Callable, Iterator

import can
import cantools
import pytest
from eampc.readiness.interface import judge_interface
from toy_daemon import DBC, UDP_PORT, EncoderNode, crc8_j1850

Eampc = Callable[..., subprocess.CompletedProcess[str]]
URL = f"udp_multicast:239.74.163.2:{UDP_PORT}"

# `ip -details -statistics -json link show dev can0` of a kvaser_pci, cut to what is read.
LINK = {
    "ifname": "can0",
    "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
    "txqlen": 10,
    "linkinfo": {
        "info_kind": "can",
        "info_data": {
            "state": "ERROR-ACTIVE",
            "berr_counter": {"tx": 0, "rx": 0},
            "restart_ms": 100,
            "bittiming": {"bitrate": 1000000},
        },
        "info_xstats": {"restarts": 2, "bus_error": 7, "error_passive": 1, "bus_off": 2},
    },
    "stats64": {"rx": {"dropped": 3, "over_errors": 1}, "tx": {"dropped": 0}},
}
QUEUES = [{"kind": "pfifo_fast", "dev": "can0", "qlen": 0}]


def wrong(changes: dict | None = None, flags: list[str] | None = None, qlen: int = 0) -> set[str]:
    link = copy.deepcopy(LINK)
    link["linkinfo"]["info_data"].update(changes or {})
    if flags is not None:
        link["flags"] = flags
    findings = judge_interface("can0", [link], [{**QUEUES[0], "qlen": qlen}])
    for finding in findings:
        assert (finding.remedy != "") == (finding.ok is False), finding
    return {finding.topic for finding in findings if finding.ok is False}


def test_a_healthy_interface_is_ready() -> None:
    findings = {f.topic: f for f in judge_interface("can0", [LINK], QUEUES)}
    assert wrong() == set()
    assert findings["bit rate"].found == "1000 kbit/s"
    assert findings["dropped frames"].found.startswith("4 ")
    assert "2 times bus-off" in findings["controller so far"].found


def test_what_is_wrong_with_an_interface_is_named() -> None:
    assert wrong(flags=["NOARP", "ECHO"]) == {"interface"}
    assert wrong({"state": "BUS-OFF"}) == {"controller"}
    assert wrong({"state": "ERROR-PASSIVE"}) == {"controller"}
    assert wrong({"berr_counter": {"tx": 128, "rx": 0}}) == {"controller"}
    assert wrong({"berr_counter": {"tx": 127, "rx": 127}}) == set()
    assert wrong({"restart_ms": 0}) == {"restart after bus-off"}
    assert wrong({"bittiming": {}}) == {"bit rate"}
    # The command that an earlier sender left behind.
    assert wrong(qlen=1) == {"waiting frames"}
    assert {f.topic for f in judge_interface("can9", [], [])} == {"interface"}


def test_a_long_queue_matters_on_a_real_bus_only() -> None:
    link = {**LINK, "txqlen": 1000}
    assert "queue length" in {f.topic for f in judge_interface("can0", [link], []) if not f.ok}
    virtual = {**LINK, "txqlen": 1000, "linkinfo": {"info_kind": "vcan"}}
    assert all(f.ok is not False for f in judge_interface("vcan0", [virtual], []))


class Nodes:
    """An encoder at 200 Hz with a valve node beside it, in a thread."""

    def __init__(self) -> None:
        self._database = cantools.database.load_file(DBC)
        self._encoder = EncoderNode()
        self._stop = threading.Event()
        self.skip_every = 0
        self.supply_kPa = 900.0
        self.with_valve_node = True
        self._thread = threading.Thread(target=self._send)

    def start(self) -> "Nodes":
        self._thread.start()
        return self

    def stop(self) -> None:
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _send(self) -> None:
        with can.Bus(
            interface="udp_multicast", channel="239.74.163.2", port=UDP_PORT, hop_limit=0, fd=False
        ) as bus:
            count = 0
            while not self._stop.wait(0.005):
                count += 1
                frame = self._encoder.frame(0.25)
                if self.skip_every == 0 or count % self.skip_every != 0:
                    bus.send(frame)
                if self.with_valve_node:
                    bus.send(self._message("ValveFeedback", SupplyPressure=self.supply_kPa))
                    if count % 20 == 0:
                        bus.send(self._message("Heartbeat", State=5))

    def _message(self, name: str, **values: float) -> can.Message:
        message = self._database.get_message_by_name(name)
        filled = {signal.name: 0 for signal in message.signals} | values
        data = bytearray(message.encode(filled, strict=False))
        if any(signal.name == "Crc" for signal in message.signals):
            byte = message.get_signal_by_name("Crc").start // 8
            rest = bytes(data[:byte] + data[byte + 1 :])
            data[byte] = crc8_j1850(struct.pack("<H", message.frame_id) + rest)
        return can.Message(
            arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=data
        )


@pytest.fixture
def nodes() -> Iterator[Nodes]:
    found = Nodes()
    yield found
    found.stop()


def topics(eampc: Eampc, *arguments: str) -> dict[str, dict]:
    done = eampc("check", "rigs/reference", "--bus", URL, "--seconds", "1", "--json", *arguments)
    told = json.loads(done.stdout)
    assert told["ready"] == (done.returncode == 0)
    assert done.returncode in (0, 1), done.stderr
    return {finding["topic"]: finding for finding in told["findings"]}


def test_the_nodes_of_a_bus_are_seen(eampc: Eampc, nodes: Nodes) -> None:
    nodes.start()
    found = topics(eampc)
    content = "frames, 0 damaged, 0 counter gaps"
    assert content in found["valve feedback ValveFeedback"]["found"]
    assert content in found["encoder JointEncoder"]["found"]
    assert "state 5" in found["heartbeat Heartbeat"]["found"]
    assert found["supply pressure"] == {
        "topic": "supply pressure",
        "found": "900 kPa",
        "ok": True,
        "remedy": "",
    }
    assert found["valve commands"]["ok"] is True
    assert found["other frames"]["found"].startswith("none")


def test_missing_nodes_and_lost_frames_are_named(eampc: Eampc, nodes: Nodes) -> None:
    nodes.skip_every = 10
    nodes.with_valve_node = False
    nodes.start()
    found = topics(eampc)
    encoder = found["encoder JointEncoder"]
    assert encoder["ok"] is False
    assert " 0 counter gaps" not in encoder["found"]
    for topic in ("valve feedback ValveFeedback", "heartbeat Heartbeat"):
        assert found[topic]["ok"] is False
        assert "powered" in found[topic]["remedy"]


def test_a_dead_bus_is_not_ready_and_says_what_to_do(eampc: Eampc) -> None:
    done = eampc("check", "rigs/reference", "--bus", URL, "--seconds", "0.3")
    assert done.returncode == 1
    assert "✗ encoder rate: 0 frames of 0x181" in done.stdout
    assert "→ is it powered" in done.stdout
    assert len(done.stderr.splitlines()) == 1


def test_a_misspelt_bus_is_bad_input(eampc: Eampc) -> None:
    done = eampc("check", "rigs/reference", "--bus", "socketcam:can0")
    assert done.returncode == 2
    assert "socketcan" in done.stderr
