"""The rig as a node of the bus: encoder and feedback frames out, valve commands in.

Order on the bus per frame: what node_messages sends, then JointEncoder. Frames hold nothing of the
wall clock, so equal commands give equal bytes.
"""

from __future__ import annotations

import math

import can
from eampc_rig.frames import Frames
from eampc_rig.rig_file import Rig

from plant_emulator.canopen_devices import CanopenDevices
from plant_emulator.command_log import CommandLog
from plant_emulator.encoder import Encoder
from plant_emulator.fault_injection import Delivery, FaultInjector
from plant_emulator.node_messages import NodeMessages, message_of
from plant_emulator.plant import Plant, PlantSnapshot
from plant_emulator.truth_log import TruthRow
from plant_emulator.valve_node import ValveNode


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
        commands: CommandLog,
        inputs_crc32: int | None = None,
    ) -> None:
        """inputs_crc32: what the node's identity says; the rig's own if None."""
        self.period_s = rig.control.period_s
        self.valve_node = valve_node
        self._frames = frames
        self._plant = plant
        self._encoder = encoder
        self._commands = commands
        self.faults = faults
        self._supply_kPa = rig.emulator.supply_pressure_kPa
        crc32 = rig.inputs_crc32 if inputs_crc32 is None else inputs_crc32
        self._messages = NodeMessages(frames, faults, self.period_s, crc32)
        self._canopen = None
        if rig.emulator.canopen is not None:
            self._canopen = CanopenDevices(rig, valve_node)
        self._replies: list[can.Message] = []
        self._frame = 0
        self._snapshot: PlantSnapshot = plant.snapshot()

    def begin_frame(self, frame: int) -> list[can.Message]:
        """Start period `frame`; return what goes out before the encoder frame."""
        self._frame = frame
        self._plant.begin_frame(frame)
        self._snapshot = self._plant.snapshot()
        status = self.valve_node.take_status()
        if self.faults.silent(frame):
            return []
        if self._canopen is not None:
            return self._canopen.begin_frame(self.period_s, self.faults, frame)
        feedback = {
            "pressure1": self._snapshot.pressure1_kPa,
            "pressure2": self._snapshot.pressure2_kPa,
            "supply_pressure": self._supply_kPa,
            "status": status,
        }
        return self._messages.of_frame(frame, feedback)

    def encoder_deliveries(self) -> list[Delivery]:
        """Measure; return the encoder frame of this period as the faults let it out."""
        if self._canopen is not None and not self._canopen.encoder.operational:
            return []
        truth = self._snapshot
        angle, velocity = self._encoder.measure(truth.angle_rad, truth.velocity_rad_s)
        angle, velocity = self.faults.measured(self._frame, angle, velocity)
        codec, values = self._frames.encoder, {"angle": angle, "velocity": velocity}
        if self.faults.holds("encoder_status", self._frame) and "status" in codec.roles:
            values["status"] = codec.range_of("status")[1]
        beyond = None
        if self.faults.holds("encoder_out_of_range", self._frame):
            beyond = codec.value_beyond_range("angle")
        if beyond is not None:
            values["angle"] = beyond
        data = codec.encode(values, self._frame, hold_in_range=beyond is None)
        return self.faults.deliveries(self._frame, data)

    def encoder_message(self, data: bytes) -> can.Message:
        """Return the encoder frame that carries these bytes."""
        return message_of(self._frames.encoder, data)

    def receive(self, message: can.Message, offset_s: float) -> bool:
        """Take a frame that arrived `offset_s` into the period; return whether it is a command."""
        if self._canopen is not None:
            self._replies += self._canopen.receive(message)
        if not self.valve_node.is_command(message):
            return False
        if self._canopen is not None and not self._canopen.module.operational:
            return True
        self.advance_to(offset_s)
        self._commands.append(self._frame, offset_s, bytes(message.data))
        if self.valve_node.receive(bytes(message.data)):
            self._plant.command(self.valve_node.u1_V, self.valve_node.u2_V)
        return True

    @property
    def waits_for_start(self) -> bool:
        """Whether a CANopen device still waits to be started: it sends no encoder frame."""
        return self._canopen is not None and self._canopen.waits_for_start

    def idle_messages(self, duration_s: float) -> list[can.Message]:
        """Let time pass before the first frame; return what CANopen devices say of their own."""
        return [] if self._canopen is None else self._canopen.idle(duration_s)

    def take_replies(self) -> list[can.Message]:
        """Return what the frames received so far are answered with, each once."""
        replies, self._replies = self._replies, []
        return replies

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
