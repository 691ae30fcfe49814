"""Which messages and signals of the DBC mean what: section [bus]."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from eampc_rig.field_types import Name, Section


class EncoderMessage(Section):
    """Table bus.encoder. Without velocity_signal the encoder is position-only."""

    message: Name
    angle_signal: Name
    velocity_signal: Name | None = None
    counter_signal: Name | None = None
    crc_signal: Name | None = None
    status_signal: Name | None = None


class ValveCommandMessage(Section):
    """Table bus.valve_command: both voltages in one frame."""

    message: Name
    u1_signal: Name
    u2_signal: Name
    enable_signal: Name | None = None
    counter_signal: Name | None = None
    crc_signal: Name | None = None


class ValveFeedbackMessage(Section):
    """Table bus.valve_feedback: what the valve node measures."""

    message: Name
    pressure1_signal: Name
    pressure2_signal: Name
    supply_pressure_signal: Name | None = None
    status_signal: Name | None = None
    counter_signal: Name | None = None
    crc_signal: Name | None = None


class SyncMessage(Section):
    """Table bus.sync: sent by the daemon when control.trigger is "sync"."""

    message: Name
    counter_signal: Name | None = None


class HeartbeatMessage(Section):
    """Table bus.heartbeat: sent by the joint node every 0.1 s; the daemon watches for it.

    state_signal carries CANopen's node state; 0 says that the node has just started.
    """

    message: Name = "Heartbeat"
    state_signal: Name | None = None
    crc_signal: Name | None = None


class EmergencyMessage(Section):
    """Table bus.emergency: the node's own alarm. Code 0 takes it back; without error_code_signal
    every frame is an alarm."""

    message: Name
    error_code_signal: Name | None = None
    crc_signal: Name | None = None


class EStopMessage(Section):
    """Table bus.e_stop: any raw value of stop_signal but released_raw is a pressed button."""

    message: Name
    stop_signal: Name
    released_raw: Annotated[int, Field(ge=0)] = 0
    crc_signal: Name | None = None


class IdentityMessage(Section):
    """Table bus.identity: for which rig the node was set up, as the law file's inputs_crc32."""

    message: Name
    inputs_crc32_signal: Name
    crc_signal: Name | None = None


class NmtStartMessage(Section):
    """Table bus.nmt_start: CANopen's command that starts the nodes. The daemon sends it at its own
    start and, at rest, to a node whose heartbeat says that it is not operational; node 0 is all."""

    message: Name
    command_signal: Name
    node_signal: Name
    command: Annotated[int, Field(ge=0, le=255)] = 1
    node: Annotated[int, Field(ge=0, le=127)] = 0
    operational_raw: Annotated[int, Field(ge=0, le=255)] = 5


class BusSection(Section):
    """Section [bus]. The daemon monitors the messages that have a table here; the emulator also
    sends the DBC's message Heartbeat where there is no bus.heartbeat."""

    dbc: Name
    encoder: EncoderMessage
    valve_command: ValveCommandMessage
    valve_feedback: ValveFeedbackMessage | None = None
    sync: SyncMessage | None = None
    heartbeat: HeartbeatMessage | None = None
    emergency: EmergencyMessage | None = None
    e_stop: EStopMessage | None = None
    identity: IdentityMessage | None = None
    nmt_start: NmtStartMessage | None = None
