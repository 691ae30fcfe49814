"""What the node sends beside encoder frames: E-stop, emergency, heartbeat, identity, feedback."""

from __future__ import annotations

import can
from eampc_rig.frames import Frames
from eampc_rig.message_codec import MessageCodec

from plant_emulator.fault_injection import FaultInjector

CYCLE_S = 0.1  # of E-stop, heartbeat and identity
HEARTBEAT_OPERATIONAL = 5  # CiA 301's NMT state
EMERGENCY_CODE = 0x5000  # CiA 301: device hardware
NO_ERROR = 0x0000
# What the identity's value is changed by while law_mismatch holds.
OTHER_RIG = 1


class NodeMessages:
    """Frames of the monitored messages, in the order above; a rig that has no such message sends
    none."""

    def __init__(
        self, frames: Frames, faults: FaultInjector, period_s: float, inputs_crc32: int
    ) -> None:
        self._frames = frames
        self._faults = faults
        self._inputs_crc32 = inputs_crc32
        self._every = max(1, round(CYCLE_S / period_s))
        self._pressed = False
        self._alarmed = False
        self._mistaken = False

    def of_frame(self, frame: int, feedback: dict[str, float]) -> list[can.Message]:
        """Return what goes out before encoder frame `frame`; feedback: values by role."""
        due = frame % self._every == 0
        messages = [
            *self._e_stop(frame, due),
            *self._emergency(frame),
            *self._heartbeat(frame, due),
            *self._identity(frame, due),
        ]
        codec = self._frames.valve_feedback
        if codec is not None and not self._faults.holds("supply_unknown", frame):
            if self._faults.holds("supply_pressure", frame):
                feedback = {**feedback, "supply_pressure": 0.0}
            messages.append(message_of(codec, codec.encode(feedback, frame)))
        return messages

    def _e_stop(self, frame: int, due: bool) -> list[can.Message]:
        codec = self._frames.e_stop
        if codec is None:
            return []
        pressed = self._faults.holds("e_stop", frame)
        changed, self._pressed = pressed != self._pressed, pressed
        silent = self._faults.holds("e_stop_silent", frame)
        if silent or not (due or changed or pressed):
            return []
        released = self._frames.e_stop_released_raw
        layout = codec.signal_layout("stop")
        raw = released if not pressed else (0 if released else 1)
        return [
            message_of(codec, codec.encode({"stop": raw * layout["factor"] + layout["offset"]}))
        ]

    def _emergency(self, frame: int) -> list[can.Message]:
        codec = self._frames.emergency
        alarmed = self._faults.holds("emergency_message", frame)
        changed, self._alarmed = alarmed != self._alarmed, alarmed
        if codec is None or not changed:
            return []
        code = EMERGENCY_CODE if alarmed else NO_ERROR
        return [message_of(codec, codec.encode({"error_code": code}))]

    def _heartbeat(self, frame: int, due: bool) -> list[can.Message]:
        codec = self._frames.heartbeat
        if codec is None or not due or self._faults.holds("heartbeat_lost", frame):
            return []
        return [message_of(codec, codec.encode({"state": HEARTBEAT_OPERATIONAL}))]

    def _identity(self, frame: int, due: bool) -> list[can.Message]:
        codec = self._frames.identity
        if codec is None:
            return []
        mistaken = self._faults.holds("law_mismatch", frame)
        changed, self._mistaken = mistaken != self._mistaken, mistaken
        if not (due or changed):
            return []
        value = self._inputs_crc32 ^ (OTHER_RIG if mistaken else 0)
        return [message_of(codec, codec.encode({"inputs_crc32": value}))]


def message_of(codec: MessageCodec, data: bytes) -> can.Message:
    """Return a bus frame of this message that carries these bytes."""
    return can.Message(
        arbitration_id=codec.frame_id, is_extended_id=codec.is_extended, data=data, check=False
    )
