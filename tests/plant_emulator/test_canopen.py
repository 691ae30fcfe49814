"""The emulated CANopen devices before an independent master: the PyPI package canopen."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import canopen
import pytest
from canopen.objectdictionary import ODVariable, datatypes
from eampc_rig import Rig, load_rig, open_bus, resolve_frames

from plant_emulator.canopen_devices import CanopenDevices
from plant_emulator.command_log import CommandLog
from plant_emulator.encoder import Encoder
from plant_emulator.fault_injection import FaultInjector
from plant_emulator.joint_node import JointNode
from plant_emulator.plant import Plant
from plant_emulator.valve_node import ValveNode

RIG = Path(__file__).parents[2] / "rigs" / "cia-module"
LIMIT_S = 60.0  # a hanging test ends; no verdict hangs on it
OBJECTS = (
    ("heartbeat", 0x1017, 0, datatypes.UNSIGNED16),
    ("device_type", 0x1000, 0, datatypes.UNSIGNED32),
    ("error_mode", 0x6443, 1, datatypes.UNSIGNED8),
    ("error_value", 0x6444, 1, datatypes.INTEGER32),
)


def dictionary() -> canopen.ObjectDictionary:
    """As an EDS of the module would say it."""
    od = canopen.ObjectDictionary()
    for name, index, sub, kind in OBJECTS:
        variable = ODVariable(name, index, sub)
        variable.data_type = kind
        if sub == 0:
            od.add_object(variable)
            continue
        record = canopen.objectdictionary.ODRecord(f"{name}_record", index)
        record.add_member(variable)
        od.add_object(record)
    return od


class EmulatedRig:
    """The joint node on one end of a bus, the master on the other; stepped by the test."""

    def __init__(self, rig: Rig, url: str) -> None:
        self.rig, self.frames = rig, resolve_frames(rig)
        self.valves = ValveNode(
            self.frames.valve_command, rig.valve.safe_V, rig.emulator.valve_timeout_s
        )
        self.node = JointNode(
            rig,
            self.frames,
            Plant(rig),
            Encoder.from_rig(rig, self.frames),
            self.valves,
            FaultInjector((), rig.control.period_s),
            CommandLog(None, self.frames.valve_command),
        )
        self.bus = open_bus(url)
        self.frame = 0

    def period(self) -> int:
        """One control period; return how many encoder frames went out."""
        for message in self.node.begin_frame(self.frame):
            self.bus.send(message)
        sent = self.node.encoder_deliveries()
        for delivery in sent:
            self.bus.send(self.node.encoder_message(delivery.data))
        while (message := self.bus.recv(0.001)) is not None:
            self.node.receive(message, 0.0)
            for reply in self.node.take_replies():
                self.bus.send(reply)
        self.node.end_frame(0.0)
        self.frame += 1
        return len(sent)

    def until(self, condition: Callable[[], bool]) -> None:
        limit = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < limit
            self.period()

    def command(self, u1_V: float, u2_V: float) -> can.Message:
        codec = self.frames.valve_command
        data = codec.encode({"u1": u1_V, "u2": u2_V})
        return can.Message(arbitration_id=codec.frame_id, is_extended_id=False, data=data)


@pytest.fixture(params=["multicast", pytest.param("vcan0", marks=pytest.mark.vcan)])
def url(request: pytest.FixtureRequest) -> str:
    if request.param == "vcan0":
        return "socketcan:vcan0"
    return f"udp_multicast:239.74.163.13:{44300 + os.getpid() % 1000}"


@pytest.fixture
def emulated(url: str) -> Iterator[EmulatedRig]:
    rig = EmulatedRig(load_rig(RIG), url)
    yield rig
    rig.bus.shutdown()


@pytest.fixture
def network(url: str) -> Iterator[canopen.Network]:
    network = canopen.Network(bus=open_bus(url))
    network.connect()
    yield network
    network.disconnect()


def in_background(emulated: EmulatedRig, action: Callable[[], object]) -> object:
    """A blocking call of the master's, while the rig goes on."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool:
        result = pool.submit(action)
        emulated.until(result.done)
        return result.result()


def test_boot_up_start_and_pdos(emulated: EmulatedRig, network: canopen.Network) -> None:
    module = network.add_node(2, dictionary())
    in_background(emulated, lambda: module.nmt.wait_for_heartbeat(LIMIT_S))
    assert module.nmt.state == "PRE-OPERATIONAL"
    assert emulated.period() == 0  # no PDO before the start
    network.nmt.state = "OPERATIONAL"
    emulated.until(lambda: not emulated.node.waits_for_start)
    in_background(emulated, lambda: module.nmt.wait_for_heartbeat(LIMIT_S))
    assert module.nmt.state == "OPERATIONAL"
    assert emulated.period() == 1
    module.nmt.state = "STOPPED"
    emulated.until(lambda: emulated.node.waits_for_start)


def test_objects_by_sdo(emulated: EmulatedRig, network: canopen.Network) -> None:
    module = network.add_node(2, dictionary())
    emulated.period()

    def talk() -> tuple[int, ...]:
        module.sdo[0x6444][1].raw = 6553
        module.sdo[0x1017].raw = 50
        return (
            module.sdo[0x1000].raw,
            int.from_bytes(module.sdo.upload(0x1402, 5), "little"),
            module.sdo[0x6443][1].raw,
            module.sdo[0x6444][1].raw,
            module.sdo[0x1017].raw,
        )

    assert in_background(emulated, talk) == (0x00080191, 20, 1, 6553, 50)

    def refused() -> int:
        try:
            module.sdo[0x1000].raw = 0
        except canopen.SdoAbortedError as error:
            return error.code
        return 0

    assert in_background(emulated, refused) == 0x06010002  # read only
    assert in_background(emulated, lambda: abort_code(module, 0x2000)) == 0x06020000


def abort_code(node: canopen.RemoteNode, index: int) -> int:
    try:
        node.sdo.upload(index, 0)
    except canopen.SdoAbortedError as error:
        return error.code
    return 0


def test_silence_of_the_master_is_emcy_and_the_error_value(
    emulated: EmulatedRig, network: canopen.Network
) -> None:
    """0x6444 of output 1 is set to 2 V: after the time-out that is on the valve, not safe_V."""
    module = network.add_node(2, dictionary())
    emulated.period()

    def set_up() -> None:
        module.sdo[0x6444][1].raw = round(2.0 * 32767 / 10.0)

    in_background(emulated, set_up)
    network.nmt.state = "OPERATIONAL"
    emulated.until(lambda: not emulated.node.waits_for_start)
    network.bus.send(emulated.command(6.0, 4.0))
    emulated.until(lambda: not emulated.valves.timed_out)
    assert emulated.valves.u1_V == pytest.approx(6.0, abs=2e-4)
    emulated.until(lambda: len(module.emcy.active) > 0)
    assert module.emcy.active[0].code == 0x8250
    assert emulated.valves.u1_V == pytest.approx(2.0, abs=2e-4)
    assert emulated.valves.u2_V == 0.0
    network.bus.send(emulated.command(5.0, 5.0))
    emulated.until(lambda: len(module.emcy.active) == 0)


def test_outputs_stay_where_the_error_mode_is_0(emulated: EmulatedRig) -> None:
    devices = CanopenDevices(emulated.rig, emulated.valves)
    devices.module.objects[0x6443, 2].value = 0
    devices.idle(0.0)
    devices.begin_frame(0.005, FaultInjector((), 0.005), 0)
    emulated.valves.receive(bytes(emulated.command(6.0, 4.0).data))
    assert emulated.valves.elapse(0.03)
    assert emulated.valves.u1_V == 0.0
    assert emulated.valves.u2_V == pytest.approx(4.0, abs=2e-4)
