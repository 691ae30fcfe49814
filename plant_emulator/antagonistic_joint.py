"""A joint between two muscles, equations (4) and (5), not linearised.

ε1 = ε0 + r θ/L0, ε2 = ε0 − r θ/L0;  J θ̈ + b_v θ̇ = (F1 − F2) r + 𝒢, 𝒢/J = d.
"""

from __future__ import annotations

from dataclasses import dataclass

from eampc_rig.plant_sections import JointSection, MuscleSection

from plant_emulator.muscle_force import MuscleForce


@dataclass(frozen=True, slots=True)
class AntagonisticJoint:
    """J in kg m², b_v in N m s/rad, r and L0 in m; both muscles alike."""

    moment_of_inertia_kg_m2: float
    viscous_damping_N_m_s_rad: float
    gear_radius_m: float
    initial_contraction: float
    initial_length_m: float
    muscle: MuscleForce

    @classmethod
    def from_rig(cls, joint: JointSection, muscle: MuscleSection) -> AntagonisticJoint:
        """Take the numbers of sections [joint] and [muscle]."""
        return cls(
            joint.moment_of_inertia_kg_m2,
            joint.viscous_damping_N_m_s_rad,
            joint.gear_radius_m,
            muscle.initial_contraction_ratio,
            muscle.initial_length_m,
            MuscleForce.from_rig(muscle),
        )

    def contractions(self, angle_rad: float) -> tuple[float, float]:
        """Return (ε1, ε2) of equation (4)."""
        shift = self.gear_radius_m * angle_rad / self.initial_length_m
        return self.initial_contraction + shift, self.initial_contraction - shift

    def muscle_torque_N_m(self, angle_rad: float, p1_Pa: float, p2_Pa: float) -> float:
        """Return (F1 − F2) r in N m, equations (3) to (5)."""
        contraction1, contraction2 = self.contractions(angle_rad)
        force = self.muscle.force_N
        return (force(p1_Pa, contraction1) - force(p2_Pa, contraction2)) * self.gear_radius_m

    def acceleration_rad_s2(
        self,
        angle_rad: float,
        velocity_rad_s: float,
        p1_Pa: float,
        p2_Pa: float,
        friction_N_m: float,
        disturbance_rad_s2: float,
    ) -> float:
        """Return θ̈ in rad/s², equation (5); friction brakes, the disturbance is d = 𝒢/J of (7)."""
        torque = self.muscle_torque_N_m(angle_rad, p1_Pa, p2_Pa) - friction_N_m
        torque -= self.viscous_damping_N_m_s_rad * velocity_rad_s
        return torque / self.moment_of_inertia_kg_m2 + disturbance_rad_s2
