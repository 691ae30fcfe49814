"""The rig as a node of the bus: encoder and feedback frames out, valve commands in.

Order on the bus per frame: Heartbeat (every 0.1 s), ValveFeedback, JointEncoder. Frames hold
nothing of the wall clock, so equal commands give equal bytes.
"""

from __future__ import annotations

import math

import can
from eampc_rig.frames import Frames
from eampc_rig.message_codec import MessageCodec
from eampc_rig.rig_file import Rig

from plant_emulator.encoder import Encoder
from plant_emulator.fault_injection import Delivery, FaultInjector
from plant_emulator.plant import Plant, PlantSnapshot
from plant_emulator.truth_log import TruthRow
from plant_emulator.valve_node import ValveNode

HEARTBEAT_PERIOD_S = 0.1
HEARTBEAT_OPERATIONAL = 5  # CiA 301's NMT state


class JointNode:
    """Plant, encoder and valve node behind their frames; knows neither bus nor clock."""

    def __init__(
        self,
        rig: Rig,
        frames: Frames,
        plant: Plant,
        encoder: Encoder,
        valve_node: ValveNode,
        faults: FaultInjector,
    ) -> None:
        self.period_s = rig.control.period_s
        self.valve_node = valve_node
        self._frames = frames
        self._plant = plant
        self._encoder = encoder
        self._faults = faults
        self._supply_kPa = rig.emulator.supply_pressure_kPa
        self._heartbeat_frames = max(1, round(HEARTBEAT_PERIOD_S / self.period_s))
        self._frame = 0
        self._snapshot: PlantSnapshot = plant.snapshot()

    def begin_frame(self, frame: int) -> list[can.Message]:
        """Start period `frame`; return what goes out before the encoder frame."""
        self._frame = frame
        self._plant.begin_frame(frame)
        self._snapshot = self._plant.snapshot()
        status = self.valve_node.take_status()
        if self._faults.silent(frame):
            return []
        messages: list[can.Message] = []
        heartbeat, feedback = self._frames.heartbeat, self._frames.valve_feedback
        if heartbeat is not None and frame % self._heartbeat_frames == 0:
            data = heartbeat.encode({"state": HEARTBEAT_OPERATIONAL})
            messages.append(_message(heartbeat, data))
        if feedback is not None:
            values = {
                "pressure1": self._snapshot.pressure1_kPa,
                "pressure2": self._snapshot.pressure2_kPa,
                "supply_pressure": self._supply_kPa,
                "status": status,
            }
            messages.append(_message(feedback, feedback.encode(values, frame)))
        return messages

    def encoder_deliveries(self) -> list[Delivery]:
        """Measure; return the encoder frame of this period as the faults let it out."""
        truth = self._snapshot
        angle, velocity = self._encoder.measure(truth.angle_rad, truth.velocity_rad_s)
        angle, velocity = self._faults.measured(self._frame, angle, velocity)
        values = {"angle": angle, "velocity": velocity}
        return self._faults.deliveries(
            self._frame, self._frames.encoder.encode(values, self._frame)
        )

    def encoder_message(self, data: bytes) -> can.Message:
        """Return the encoder frame that carries these bytes."""
        return _message(self._frames.encoder, data)

    def receive(self, message: can.Message, offset_s: float) -> bool:
        """Take a frame that arrived `offset_s` into the period; return whether it is a command."""
        if not self.valve_node.is_command(message):
            return False
        self.advance_to(offset_s)
        if self.valve_node.receive(bytes(message.data)):
            self._plant.command(self.valve_node.u1_V, self.valve_node.u2_V)
        return True

    def advance_to(self, offset_s: float) -> None:
        """Let plant and valve node run up to `offset_s`; the node's time-out strikes on its way."""
        while self._plant.offset_s < offset_s:
            begin = self._plant.offset_s
            left = self.valve_node.time_left_s
            end = min(offset_s, begin + left) if left > 0.0 else offset_s
            self._plant.advance_to(end)
            if self.valve_node.elapse(end - begin):
                self._plant.command(self.valve_node.u1_V, self.valve_node.u2_V)

    def end_frame(self, sent_s: float, answered_s: float = math.nan) -> TruthRow:
        """Run to the end of the period; return its row of the truth log.

        `sent_s` and `answered_s` are CLOCK_MONOTONIC; NaN = not sent, no answer.
        """
        valve1, valve2 = self._plant.valve1, self._plant.valve2
        row = (
            self._frame,
            self._snapshot.scenario_time_s,
            self._snapshot.angle_rad,
            self._snapshot.velocity_rad_s,
            self._snapshot.disturbance_rad_s2,
            valve1.voltage_V,
            valve2.voltage_V,
            self._snapshot.pressure1_kPa,
            self._snapshot.pressure2_kPa,
            self._snapshot.torque_N_m,
            int(self.valve_node.timed_out),
            sent_s,
            answered_s,
        )
        self.advance_to(self.period_s)
        return row


def _message(codec: MessageCodec, data: bytes) -> can.Message:
    return can.Message(
        arbitration_id=codec.frame_id, is_extended_id=codec.is_extended, data=data, check=False
    )
