"""Dry friction and hysteresis of the joint, both off unless the rig file asks for them.

Coulomb: T_c tanh(θ̇/ω0), a sign function made smooth. Bouc–Wen: T_h z with
ż = θ̇ (1 − (γ + β sign(θ̇ z)) |z|ⁿ) / width, β + γ = 1, so that |z| ≤ 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from eampc_rig.plant_sections import EmulatorSection
from eampc_rig.rig_error import RigError

# Below this speed the joint creeps instead of sticking: about one count of the reference rig's
# velocity signal (0.0005 rad/s) times 20, far below any motion of interest.
COULOMB_TRANSITION_RAD_S = 0.01
# RK4 is stable on ẋ = −λx up to λh = 2.78; a quarter off for the joint's own dynamics.
STABLE_RATE_TIMES_STEP = 2.0


@dataclass(frozen=True, slots=True)
class Friction:
    """Torques in N m, width in rad; zero torque = off."""

    coulomb_N_m: float = 0.0
    hysteresis_N_m: float = 0.0
    hysteresis_width_rad: float = 1.0
    hysteresis_shape: float = 0.5
    hysteresis_exponent: float = 1.0

    @classmethod
    def from_rig(cls, emulator: EmulatorSection) -> Friction:
        """Take emulator.coulomb_friction_N_m and emulator.bouc_wen."""
        table = emulator.bouc_wen
        if table is None:
            return cls(emulator.coulomb_friction_N_m)
        return cls(
            emulator.coulomb_friction_N_m,
            table.torque_max_N_m,
            table.width_rad,
            table.shape,
            table.exponent,
        )

    def check_step(self, moment_of_inertia_kg_m2: float, period_s: float, substeps: int) -> None:
        """Raise RigError if RK4 with this many substeps would be unstable in the Coulomb band."""
        rate = self.coulomb_N_m / (moment_of_inertia_kg_m2 * COULOMB_TRANSITION_RAD_S)
        needed = math.ceil(rate * period_s / STABLE_RATE_TIMES_STEP)
        if substeps < needed:
            raise RigError(
                f"emulator.substeps is {substeps}, but emulator.coulomb_friction_N_m = "
                f"{self.coulomb_N_m} needs at least {needed} to integrate stably; raise it"
            )

    def torque_N_m(self, velocity_rad_s: float, hysteresis: float) -> float:
        """Return the braking torque for a speed in rad/s and the hysteresis state z."""
        torque = self.hysteresis_N_m * hysteresis
        if self.coulomb_N_m:
            torque += self.coulomb_N_m * math.tanh(velocity_rad_s / COULOMB_TRANSITION_RAD_S)
        return torque

    def hysteresis_rate_per_s(self, velocity_rad_s: float, hysteresis: float) -> float:
        """Return ż in 1/s."""
        if not self.hysteresis_N_m:
            return 0.0
        shape = self.hysteresis_shape
        along = math.copysign(1.0, velocity_rad_s * hysteresis)
        bend = (1.0 - shape + shape * along) * abs(hysteresis) ** self.hysteresis_exponent
        return velocity_rad_s * (1.0 - bend) / self.hysteresis_width_rad
