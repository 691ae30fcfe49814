"""The two devices of a CANopen rig: a CiA 406 encoder and a CiA 401 module of analogue outputs.

The module guards its command PDO itself (event timer 0x1402:05): without one in time it reports
0x8250 and its outputs go to their error values (0x6444) where 0x6443 says so, and stay as they are
where it does not.
"""

from __future__ import annotations

import can
from eampc_rig.rig_file import Rig

from plant_emulator.canopen_node import CanopenNode, SdoObject
from plant_emulator.fault_injection import FaultInjector
from plant_emulator.valve_node import ValveNode

FULL_SCALE = 32767  # of 0x6411 and 0x6444
COMMAND_TIMEOUT_MS = (0x1402, 5)
ERROR_MODE, ERROR_VALUE = 0x6443, 0x6444
PDO_TIMED_OUT, COMMUNICATION_ERROR, NO_ERROR = 0x8250, 0x11, 0
DEVICE_HARDWARE, DEVICE_ERROR = 0x5000, 0x81  # what the fault emergency_message reports
_ENCODER_PROFILE, _OUTPUT_PROFILE = 0x00020196, 0x00080191


class CanopenDevices:
    """Both nodes, and the module's hold on the valve node."""

    def __init__(self, rig: Rig, valve_node: ValveNode) -> None:
        """Power on: the module's error values are valve.safe_V, its time-out the emulated one."""
        layout = rig.emulator.canopen
        assert layout is not None
        self._valve_node = valve_node
        self._volts_per_count = rig.valve.max_V / FULL_SCALE
        safe = round(rig.valve.safe_V / self._volts_per_count)
        self.encoder = CanopenNode(layout.encoder_node, {(0x1000, 0): _constant(_ENCODER_PROFILE)})
        timeout_ms = round(1e3 * rig.emulator.valve_timeout_s)
        self.module = CanopenNode(
            layout.module_node,
            {
                (0x1000, 0): _constant(_OUTPUT_PROFILE),
                COMMAND_TIMEOUT_MS: SdoObject(timeout_ms, "H", writable=True),
                (ERROR_MODE, 1): SdoObject(1, "B", writable=True),
                (ERROR_MODE, 2): SdoObject(1, "B", writable=True),
                (ERROR_VALUE, 1): SdoObject(safe, "i", writable=True),
                (ERROR_VALUE, 2): SdoObject(safe, "i", writable=True),
            },
        )
        self._reported = False
        self._alarmed = False

    @property
    def waits_for_start(self) -> bool:
        """Whether a node has not been started yet."""
        return not (self.encoder.operational and self.module.operational)

    def idle(self, duration_s: float) -> list[can.Message]:
        """Return what both nodes send of their own while `duration_s` pass."""
        return [*self.encoder.elapse(duration_s), *self.module.elapse(duration_s)]

    def begin_frame(self, period_s: float, faults: FaultInjector, frame: int) -> list[can.Message]:
        """Return what both nodes send of their own at the beginning of period `frame`."""
        messages = self.encoder.elapse(period_s)
        of_module = self.module.elapse(period_s)
        if not faults.holds("heartbeat_lost", frame):
            messages += of_module
        alarmed = faults.holds("emergency_message", frame)
        if alarmed != self._alarmed:
            code, register = (DEVICE_HARDWARE, DEVICE_ERROR) if alarmed else (NO_ERROR, 0)
            messages.append(self.module.emergency(code, register))
        self._alarmed = alarmed
        self._configure_valves()
        late = self.module.operational and self._valve_node.gave_up
        if late and not self._reported:
            messages.append(self.module.emergency(PDO_TIMED_OUT, COMMUNICATION_ERROR))
        elif self._reported and not late:
            messages.append(self.module.emergency(NO_ERROR, 0))
        self._reported = late
        return messages

    def receive(self, message: can.Message) -> list[can.Message]:
        """Offer a frame to both; return their answers."""
        return [*self.encoder.receive(message), *self.module.receive(message)]

    def _configure_valves(self) -> None:
        entries = self.module.objects
        self._valve_node.timeout_s = 1e-3 * entries[COMMAND_TIMEOUT_MS].value
        self._valve_node.safe_V = (self._error_value_V(1), self._error_value_V(2))

    def _error_value_V(self, output: int) -> float | None:
        entries = self.module.objects
        if entries[ERROR_MODE, output].value == 0:
            return None
        return self._volts_per_count * entries[ERROR_VALUE, output].value


def _constant(value: int) -> SdoObject:
    return SdoObject(value, "I")
