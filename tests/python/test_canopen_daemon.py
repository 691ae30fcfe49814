"""The daemon as CANopen master before an independent slave: the PyPI package canopen."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import canopen
import pytest
from canopen.objectdictionary import ODVariable, datatypes
from eampc.hil.law_choice import cached_law
from eampc.hil.processes import Ensemble, daemon_program
from eampc.law_design import design
from eampc.operator_client import OperatorClient
from eampc_rig import Frames, load_rig, open_bus, resolve_frames

ROOT = Path(__file__).parents[2]
LIMIT_S = 60.0  # a hanging test ends; no verdict hangs on it
SMALL = {
    "control.horizon": 10,
    "control.control_horizon": 2,
    "constraints.stage_step": 10,
    # A test's own thread is no encoder: it may be late by much.
    "safety.encoder_timeout_s": 1.0,
    "safety.heartbeat_timeout_s": 3.0,
    "safety.deadline_overruns_max": 1000,
}


@pytest.fixture(params=["multicast", pytest.param("vcan0", marks=pytest.mark.vcan)])
def url(request: pytest.FixtureRequest) -> str:
    if request.param == "vcan0":
        return "socketcan:vcan0"
    return f"udp_multicast:239.74.163.14:{45300 + os.getpid() % 1000}"


@pytest.fixture
def network(url: str) -> Iterator[canopen.Network]:
    network = canopen.Network(bus=open_bus(url))
    network.connect()
    yield network
    network.disconnect()


def module_of(network: canopen.Network) -> canopen.LocalNode:
    """Node 2 with a heartbeat, as it is after power-on."""
    od = canopen.ObjectDictionary()
    heartbeat = ODVariable("heartbeat", 0x1017)
    heartbeat.data_type = datatypes.UNSIGNED16
    heartbeat.value = 100
    od.add_object(heartbeat)
    node = network.create_node(2, od)
    node.nmt.state = "PRE-OPERATIONAL"
    node.nmt.start_heartbeat(100)
    return node


def wait_for(condition: Callable[[], bool], what: str) -> None:
    limit = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < limit, what
        time.sleep(0.01)


class Encoder(can.Listener):
    """Node 1: a position for every SYNC."""

    def __init__(self, network: canopen.Network, frames: Frames) -> None:
        self._network, self._frames = network, frames
        self.syncs = 0

    def on_message_received(self, message: can.Message) -> None:
        sync, codec = self._frames.sync, self._frames.encoder
        if sync is None or message.arbitration_id != sync.frame_id:
            return
        self.syncs += 1
        self._network.send_message(codec.frame_id, codec.encode({"angle": 0.0}))


def test_daemon_starts_the_node_and_watches_it(
    url: str, network: canopen.Network, tmp_path: Path
) -> None:
    rig = load_rig(ROOT / "rigs" / "cia-module", overrides=SMALL)
    law = cached_law(rig, lambda path: design(rig).save(path))
    encoder = Encoder(network, resolve_frames(rig))
    network.notifier.add_listener(encoder)
    socket = tmp_path / "s"
    command = [daemon_program(), "--law", str(law), "--bus", url, "--socket", str(socket)]
    command += ["--lcm-url", "none", "--emulation"]
    with Ensemble() as ensemble:
        ensemble.start_daemon(command, tmp_path / "eampcd.log")
        wait_for(lambda: encoder.syncs > 10, "the daemon sends no SYNC")
        with OperatorClient(socket, timeout_s=LIMIT_S) as client:
            wait_for(lambda: client.status()["mode"] == "DISARMED", "no encoder frame counts")
            # Nobody at node 2: its heartbeat is missing, and the joint is not armed.
            assert not client.request("arm")["ok"]
            # It comes up after the daemon, pre-operational, and is started.
            module = module_of(network)
            wait_for(lambda: module.nmt.state == "OPERATIONAL", "the node was not started")
            wait_for(lambda: client.request("arm")["ok"], "the joint does not arm")
            # An emergency ends it; the node's own reset code allows a reset.
            module.emcy.send(0x5000, 0x81)
            wait_for(lambda: client.status()["fault_number"] == 16, "the EMCY was not seen")
            wait_for(lambda: client.status()["mode"] == "FAULT", "the joint did not stop")
            assert not client.request("reset")["ok"]
            module.emcy.reset()
            wait_for(lambda: client.request("reset")["ok"], "the reset was refused")
            # A node that leaves the operational state at rest is started again.
            module.nmt.state = "PRE-OPERATIONAL"
            wait_for(lambda: module.nmt.state == "OPERATIONAL", "the node was not started again")
            module.nmt.stop_heartbeat()
