"""The law file's section safety: thresholds and actions of the fault matrix, from a rig."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eampc_rig import Rig

# Keys of [safety] that the law file carries as they are.
_CARRIED = (
    "encoder_timeout_s",
    "arming_ramp_s",
    "reduced_limits_s",
    "reduced_control_share",
    "soft_stop_ramp_s",
    "encoder_invalid_frames",
    "encoder_frozen_s",
    "encoder_frozen_command_V",
    "encoder_jump_margin_rad",
    "encoder_counter_gap_max",
    "encoder_status_mask",
    "error_passive_s",
    "tx_unconfirmed_periods",
    "send_refused_frames",
    "heartbeat_timeout_s",
    "e_stop_timeout_s",
    "supply_pressure_min_kPa",
    "supply_pressure_max_kPa",
    "supply_pressure_s",
    "deadline_overruns_max",
    "deadline_overruns_window_s",
)
SAFETY_KEYS = (
    *_CARRIED,
    "reduced_slew_V_per_s",
    "encoder_jump_velocity_rad_s",
    "actions",
    "reference_angle_max_rad",
)


def safety_table(rig: Rig) -> dict[str, Any]:
    """Return the table of SAFETY_KEYS; None stands for a supply pressure without that limit."""
    from eampc_rig import FAULT_NAMES

    safety, constraints = rig.safety, rig.constraints
    return {
        **{key: getattr(safety, key) for key in _CARRIED},
        "reduced_slew_V_per_s": safety.reduced_slew_V_per_s or rig.valve.slew_max_V_per_s,
        "encoder_jump_velocity_rad_s": safety.encoder_jump_ratio * constraints.velocity_max_rad_s,
        "actions": {name: safety.action(name) for name in FAULT_NAMES},
        "reference_angle_max_rad": constraints.angle_max_rad,
    }
