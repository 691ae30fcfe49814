"""What the rig is made of: sections [rig], [joint], [muscle], [valve] and [emulator]."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from eampc_rig.field_types import Name, NonNegative, Positive, Section
from eampc_rig.scenario_sections import DisturbanceTerm


class RigSection(Section):
    """Section [rig]: what the rig is called."""

    name: Name
    description: str = ""


class JointSection(Section):
    """Section [joint]: J, b_v and r of equations (4) and (5)."""

    moment_of_inertia_kg_m2: Positive
    viscous_damping_N_m_s_rad: NonNegative
    gear_radius_m: Positive


class MuscleSection(Section):
    """Section [muscle]: F = P (k1 ε² + k2 ε + k3) + k4 of equation (3), ε0 and L0 of (4)."""

    k1_N_per_MPa: float
    k2_N_per_MPa: float
    k3_N_per_MPa: float
    k4_N: float = 0.0
    initial_contraction_ratio: Annotated[float, Field(ge=0.0, lt=1.0)]
    initial_length_m: Positive

    def linearised(self) -> MuscleSection:
        """Return the tangent of (3) at ε0: with it (5) is (9) exactly, without a term in θ² u."""
        k1, ratio = self.k1_N_per_MPa, self.initial_contraction_ratio
        return self.model_copy(
            update={
                "k1_N_per_MPa": 0.0,
                "k2_N_per_MPa": self.k2_N_per_MPa + 2.0 * k1 * ratio,
                "k3_N_per_MPa": self.k3_N_per_MPa - k1 * ratio**2,
            }
        )


class ValveSection(Section):
    """Section [valve]: k0, ku and u0 of equations (1) and (2), and the voltages allowed."""

    pressure_gain_MPa_per_V: Positive
    control_gain_V: Positive
    bias_V: float
    min_V: float
    max_V: float
    safe_V: float
    slew_max_V_per_s: Positive


class BoucWenSection(Section):
    """Table emulator.bouc_wen: hysteresis torque T_h = torque_max · z of the emulated joint.

    ż = θ̇ (1 − (γ + β sign(θ̇ z)) |z|ⁿ) / width, β = shape, γ = 1 − shape, so |z| ≤ 1.
    """

    torque_max_N_m: NonNegative
    width_rad: Positive
    shape: Annotated[float, Field(ge=0.5, le=1.0)] = 0.5
    exponent: Annotated[float, Field(ge=1.0)] = 1.0


class CanopenSection(Section):
    """Table emulator.canopen: encoder and valves are CANopen devices with these node numbers."""

    encoder_node: Annotated[int, Field(ge=1, le=127)]
    module_node: Annotated[int, Field(ge=1, le=127)]


class EmulatorSection(Section):
    """Section [emulator]: the plant that stands in for the rig; nothing here reaches the law.

    linear_muscles = true emulates (9), the paper's own plant, in place of (3).
    """

    linear_muscles: bool = False

    initial_angle_rad: float = 0.0
    initial_velocity_rad_s: float = 0.0
    hold_until_start: bool = False
    valve_time_constant_s: Positive | None = None
    valve_timeout_s: Positive = 0.02
    substeps: Annotated[int, Field(ge=1, le=10000)] = 10
    encoder_noise_rad: NonNegative = 0.0
    velocity_noise_rad_s: NonNegative = 0.0
    seed: Annotated[int, Field(ge=0)] = 1
    supply_pressure_kPa: NonNegative = 1000.0
    end_stop_rad: Positive | None = None
    coulomb_friction_N_m: NonNegative = 0.0
    bouc_wen: BoucWenSection | None = None
    canopen: CanopenSection | None = None
    disturbance: Annotated[tuple[DisturbanceTerm, ...], Field(strict=False)] = ()
