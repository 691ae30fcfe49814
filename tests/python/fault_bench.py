"""A real eampcd and the emulated rig, stepped frame by frame with faults on demand.

The emulator runs in the test's own process, so that a fault begins in exactly the state that the
test has brought the daemon into.
"""

import csv
import tempfile
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from eampc.hil.law_choice import cached_law
from eampc.hil.processes import Ensemble, daemon_program
from eampc.hil.recording import COMMAND_COLUMNS, RECORD_COLUMNS, Recording, read_recording
from eampc.law_design import design
from eampc.operator_client import OperatorClient
from eampc_rig import Rig, load_rig, open_bus, parse_bus_url, resolve_frames

from plant_emulator.bus_faults import BusFaults
from plant_emulator.can_interface import CanInterface
from plant_emulator.command_log import CommandLog
from plant_emulator.daemon_process import DaemonProcess
from plant_emulator.encoder import Encoder
from plant_emulator.fault_injection import Fault, FaultInjector
from plant_emulator.joint_node import JointNode
from plant_emulator.pacing import LockStep, RealTime
from plant_emulator.plant import Plant
from plant_emulator.valve_node import ValveNode

ROOT = Path(__file__).parents[2]
# Short ramps and time-outs, a small law, a slew limit that a jump would break: 100 episodes take
# as many seconds.
SHORT = {
    "control.horizon": 10,
    "control.control_horizon": 2,
    "constraints.stage_step": 10,
    "valve.slew_max_V_per_s": 400.0,
    "safety.reduced_slew_V_per_s": 200.0,
    "safety.arming_ramp_s": 0.2,
    "safety.reduced_limits_s": 0.05,
    "safety.soft_stop_ramp_s": 0.2,
    "safety.heartbeat_timeout_s": 0.12,
    "safety.supply_pressure_s": 0.05,
    "safety.error_passive_s": 0.05,
    "safety.encoder_frozen_s": 0.05,
    "bus.identity.message": "RigIdentity",
    "bus.identity.inputs_crc32_signal": "InputsCrc32",
}


def short_rig(**changes: object) -> Rig:
    """The reference rig with the keys above; further ones with two underscores for a dot."""
    more = {key.replace("__", "."): value for key, value in changes.items()}
    return load_rig(ROOT / "rigs" / "reference", overrides={**SHORT, **more})


class LiveFaults(FaultInjector):
    """Faults that are added while the run goes on."""

    def add(self, kind: str, first: int, count: int) -> None:
        self._faults = (*self._faults, Fault(kind, first, float(first + count)))


class FaultBench:
    """Daemon, bus and emulated rig. `frame` is the next encoder frame."""

    def __init__(self, rig: Rig, url: str, folder: Path, lockstep: bool = True) -> None:
        self.rig, self.lockstep, self.frame = rig, lockstep, 0
        self.armings: list[int] = []
        self._folder = folder
        self._url = url

    def __enter__(self) -> Self:
        rig, codecs = self.rig, resolve_frames(self.rig)
        law = cached_law(rig, lambda path: design(rig).save(path))
        self._socket_folder = tempfile.TemporaryDirectory(prefix="eampc-")
        socket = Path(self._socket_folder.name) / "s"
        command = [daemon_program(), "--law", str(law), "--bus", self._url, "--socket", str(socket)]
        command += ["--record", str(self._folder / "record.csv"), "--lcm-url", "none"]
        command += ["--emulation", *(["--lockstep"] if self.lockstep else [])]
        self._ensemble = Ensemble()
        self._daemon = self._ensemble.start_daemon(command, self._folder / "eampcd.log")
        self.client = OperatorClient(socket, timeout_s=60.0)
        self.faults = LiveFaults((), rig.control.period_s)
        self._commands = CommandLog(self._folder / "commands.csv", codecs.valve_command)
        self.valve_node = ValveNode(
            codecs.valve_command, rig.valve.safe_V, rig.emulator.valve_timeout_s
        )
        self.node = JointNode(
            rig,
            codecs,
            Plant(rig, rig.scenario("sine").disturbance),
            Encoder.from_rig(rig, codecs),
            self.valve_node,
            self.faults,
            self._commands,
        )
        self._bus = open_bus(self._url)
        address = parse_bus_url(self._url)
        on_can = address.transport == "socketcan"
        self.bus_faults = BusFaults(self.faults, CanInterface(address.channel) if on_can else None)
        stop = threading.Event()
        self._pacing: LockStep | RealTime = (
            LockStep(self._bus, self.node, stop, self.bus_faults)
            if self.lockstep
            else RealTime(
                self._bus, self.node, stop, self.bus_faults, DaemonProcess(self._daemon.pid)
            )
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.bus_faults.end()
        self.client.close()
        self._ensemble.__exit__()
        self._bus.shutdown()
        self._commands.write()
        self._socket_folder.cleanup()

    def step(self, frames: int = 1) -> None:
        for _ in range(frames):
            self._forget_delay()
            assert self._pacing.exchange(self.frame) is not None
            self.frame += 1

    def _forget_delay(self) -> None:
        # What the operator's commands took is no lateness of the emulator's: no catching up.
        if isinstance(self._pacing, RealTime) and self.frame > 0:
            due_s = self.frame * self.rig.control.period_s
            self._pacing._start_s = max(self._pacing._start_s, time.monotonic() - due_s)

    def status(self) -> dict[str, Any]:
        return self.client.status()

    def order(self, command: str) -> None:
        """An operator's command; when this returns it was obeyed, or was not."""
        if command == "arm":
            self.armings.append(self.frame)
        ahead = 2 if self.lockstep else 4
        for _ in range(20):
            at = self.status()["cycle"] + ahead
            reply = self.client.request(command, {"at_cycle": at})
            if reply["ok"]:
                break
            self.step()  # in real time the daemon's cycle may have passed meanwhile
        assert reply["ok"], reply["message"]
        self.step(ahead + 1)

    def until(self, mode: str, frames: int = 2000) -> None:
        """Step until the daemon says this mode."""
        for _ in range(0, frames, 5):
            if self.status()["mode"] == mode:
                return
            self.step(5)
        raise AssertionError(f"{self.status()} never became {mode}")

    def logs(self) -> tuple[Recording, Recording]:
        """The daemon's record and the command frames on the wire; after the context."""
        record = read_recording(self._folder / "record.csv", RECORD_COLUMNS)
        return record, read_recording(self._folder / "commands.csv", COMMAND_COLUMNS)


def write_table(path: Path, rows: list[dict[str, object]]) -> None:
    """A small CSV beside the test's log."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
