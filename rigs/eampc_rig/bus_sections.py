"""Which messages and signals of the DBC mean what: section [bus]."""

from __future__ import annotations

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
    """Table bus.heartbeat: sent by the joint node every 0.1 s."""

    message: Name = "Heartbeat"
    state_signal: Name | None = None


class BusSection(Section):
    """Section [bus]. Without bus.heartbeat, the DBC's message Heartbeat is used if it has one."""

    dbc: Name
    encoder: EncoderMessage
    valve_command: ValveCommandMessage
    valve_feedback: ValveFeedbackMessage | None = None
    sync: SyncMessage | None = None
    heartbeat: HeartbeatMessage | None = None
