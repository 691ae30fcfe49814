"""What the design needs: [model], [control], [constraints], [tightening], [estimator],
[parameter_box]; and what the daemon obeys beside [safety]: [telemetry]."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from eampc_rig.field_types import Name, NonNegative, Positive, Section


class ModelSection(Section):
    """Section [model]: what the design believes. No valve_time_constant_s = ideal valves."""

    valve_time_constant_s: Positive | None = None


class ControlSection(Section):
    """Section [control]: T, N, weights of Problem 1. control_horizon defaults to horizon."""

    period_s: Annotated[float, Field(ge=1e-4, le=1.0)]
    trigger: Literal["encoder", "sync"] = "encoder"
    formulation: Literal["paper", "tracking"] = "tracking"
    horizon: Annotated[int, Field(ge=1, le=1000)]
    control_horizon: Annotated[int, Field(ge=1, le=1000)]
    weight_angle: NonNegative
    weight_velocity: NonNegative = 0.0
    weight_control: Positive
    weight_control_rate: NonNegative = 0.0
    reference_rad: float | None = None
    reference_is_parameter: bool = False

    @model_validator(mode="before")
    @classmethod
    def _control_horizon_defaults_to_horizon(cls, table: Any) -> Any:
        if isinstance(table, dict) and "horizon" in table and "control_horizon" not in table:
            return {**table, "control_horizon": table["horizon"]}
        return table


class ConstraintsSection(Section):
    """Section [constraints]: X of Problem 1, and U if narrower than the valves allow.

    The state bounds hold at every stage_step-th stage, counted back from the horizon.
    """

    angle_max_rad: Positive
    velocity_max_rad_s: Positive
    control_max: Positive | None = None
    stage_step: Annotated[int, Field(ge=1, le=1000)] = 1
    slack_linear: NonNegative = 1000.0
    slack_quadratic: NonNegative = 10000.0


class TighteningSection(Section):
    """Section [tightening]: Theorem 3.1.

    `componentwise` reads |d| and |ḋ|; `theorem` the constants of Assumption 2.2:
    l_δ lipschitz_delta_per_s2, l_t lipschitz_time_rad_s3, b_δ bound_delta_rad_s2,
    l_δt lipschitz_delta_t_per_s3, b_δt bound_delta_t_rad_s3,
    l_δx lipschitz_delta_x_per_rad_s2, b_δx bound_delta_x_per_s2.
    """

    kind: Literal["componentwise", "theorem", "none"] = "componentwise"
    disturbance_max_rad_s2: NonNegative | None = None
    disturbance_rate_max_rad_s3: NonNegative | None = None
    lipschitz_delta_per_s2: NonNegative | None = None
    lipschitz_time_rad_s3: NonNegative | None = None
    bound_delta_rad_s2: NonNegative | None = None
    lipschitz_delta_t_per_s3: NonNegative | None = None
    bound_delta_t_rad_s3: NonNegative | None = None
    lipschitz_delta_x_per_rad_s2: NonNegative | None = None
    bound_delta_x_per_s2: NonNegative | None = None


class EstimatorSection(Section):
    """Section [estimator]: (13), (14) with rate a; or a Kalman filter for position-only encoders.

    low_pass_hz = 0 switches the low-pass on d̂ off. angle_noise_rad absent = one count of the
    encoder / √12. The walks are intensities of white noise driving d and θ̇.
    """

    kind: Literal["adaptive", "kalman"] = "adaptive"
    adaptation_rate_per_s: Positive = 5.0
    bias_compensation: bool = True
    as_printed: bool = False
    low_pass_hz: NonNegative = 0.0
    angle_noise_rad: Positive | None = None
    disturbance_walk_rad_s2_sqrt_Hz: Positive = 200.0
    velocity_walk_rad_s_sqrt_Hz: NonNegative = 0.0


class ParameterBoxSection(Section):
    """Section [parameter_box]: where the law is exact; outside it clamps and reports."""

    angle_error_max_rad: Positive | None = None
    velocity_error_max_rad_s: Positive | None = None
    valve_error_max: Positive | None = None
    reference_velocity_max_rad_s: Positive | None = None
    disturbance1_max_rad_s: Positive | None = None
    disturbance2_max_rad_s2: Positive | None = None


class TelemetrySection(Section):
    """Section [telemetry]: where LCM goes ("none" = nowhere) and every how many cycles."""

    lcm_url: Name = "udpm://239.255.76.67:7667?ttl=0"
    state_decimation: Annotated[int, Field(ge=1)] = 1
    reference_by_lcm: bool = False
