"""What the daemon watches, and how it stops: section [safety]."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from eampc_rig.field_types import NonNegative, Positive, Section

StopAction = Literal["saturate", "soft_stop", "vent_ramp", "immediate"]
Share = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]
CountOrZero = Annotated[int, Field(ge=0, le=1_000_000)]

# By number: the daemon's control::Fault without "none".
FAULT_NAMES = (
    "encoder_timeout",
    "encoder_crc",
    "encoder_length",
    "encoder_out_of_range",
    "encoder_frozen",
    "encoder_jump",
    "encoder_counter_gap",
    "encoder_status",
    "not_finite",
    "bus_off",
    "error_passive",
    "tx_unconfirmed",
    "link_down",
    "send_refused",
    "heartbeat_lost",
    "emergency_message",
    "supply_pressure",
    "deadline_overruns",
    "e_stop",
    "law_mismatch",
)


class SafetySection(Section):
    """Section [safety]: when the daemon stops, and how. A ramp of 0 s is a jump.

    Times are rounded to periods. encoder_frozen_s = 0 switches that cause off, as
    reduced_limits_s = 0 does the reduced limits; e_stop_timeout_s = 0 is for a stop button whose
    message only comes when it moves. A supply pressure without limits, an
    encoder_status_mask of 0, and the causes of messages that [bus] does not name are not watched.
    An angle jumps if it moves further than encoder_jump_ratio · constraints.velocity_max_rad_s ·
    elapsed time + encoder_jump_margin_rad.
    """

    arming_ramp_s: NonNegative = 0.5
    reduced_limits_s: NonNegative = 0.2
    reduced_control_share: Share = 0.5
    reduced_slew_V_per_s: Positive | None = None
    soft_stop_ramp_s: NonNegative = 0.5

    encoder_timeout_s: Positive = 0.02
    encoder_invalid_frames: Count = 3
    encoder_frozen_s: NonNegative = 0.1
    encoder_frozen_command_V: Positive = 0.5
    encoder_jump_ratio: Positive = 3.0
    encoder_jump_margin_rad: Positive = 0.05
    encoder_counter_gap_max: CountOrZero = 3
    encoder_status_mask: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = 0
    error_passive_s: NonNegative = 0.1
    tx_unconfirmed_periods: Count = 2
    send_refused_frames: Count = 2
    heartbeat_timeout_s: Positive = 0.35
    e_stop_timeout_s: NonNegative = 0.0
    supply_pressure_min_kPa: float | None = None
    supply_pressure_max_kPa: float | None = None
    supply_pressure_s: NonNegative = 0.1
    deadline_overruns_max: CountOrZero = 20
    deadline_overruns_window_s: Positive = 1.0

    encoder_timeout_action: StopAction = "soft_stop"
    encoder_crc_action: StopAction = "soft_stop"
    encoder_length_action: StopAction = "soft_stop"
    encoder_out_of_range_action: StopAction = "soft_stop"
    encoder_frozen_action: StopAction = "soft_stop"
    encoder_jump_action: StopAction = "soft_stop"
    encoder_counter_gap_action: StopAction = "soft_stop"
    encoder_status_action: StopAction = "soft_stop"
    not_finite_action: StopAction = "soft_stop"
    bus_off_action: StopAction = "immediate"
    error_passive_action: StopAction = "soft_stop"
    tx_unconfirmed_action: StopAction = "immediate"
    link_down_action: StopAction = "immediate"
    send_refused_action: StopAction = "immediate"
    heartbeat_lost_action: StopAction = "vent_ramp"
    emergency_message_action: StopAction = "vent_ramp"
    supply_pressure_action: StopAction = "vent_ramp"
    deadline_overruns_action: StopAction = "soft_stop"
    e_stop_action: StopAction = "immediate"
    law_mismatch_action: StopAction = "immediate"

    def action(self, fault_name: str) -> StopAction:
        """The action on the cause of that name."""
        return getattr(self, f"{fault_name}_action")

    def arming_periods(self, period_s: float) -> int:
        """Periods from the operator's edge to the first of ACTIVE."""
        return round(self.arming_ramp_s / period_s) + round(self.reduced_limits_s / period_s)
