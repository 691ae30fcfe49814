"""Pulling force of a pneumatic muscle, equation (3): F = P (k1 ε² + k2 ε + k3) + k4."""

from __future__ import annotations

from dataclasses import dataclass

from eampc_rig.plant_sections import MuscleSection

PA_PER_MPA = 1e6


@dataclass(frozen=True, slots=True)
class MuscleForce:
    """k1..k3 in N/Pa, k4 in N. The quadratic never goes slack: no cut at F = 0, as in (3)."""

    k1_N_per_Pa: float
    k2_N_per_Pa: float
    k3_N_per_Pa: float
    k4_N: float

    @classmethod
    def from_rig(cls, muscle: MuscleSection) -> MuscleForce:
        """Take the coefficients of section [muscle], given per MPa, to SI."""
        return cls(
            muscle.k1_N_per_MPa / PA_PER_MPA,
            muscle.k2_N_per_MPa / PA_PER_MPA,
            muscle.k3_N_per_MPa / PA_PER_MPA,
            muscle.k4_N,
        )

    def force_N(self, pressure_Pa: float, contraction: float) -> float:
        """Return F in N for a pressure in Pa and a contraction ratio ε, equation (3)."""
        shape = (self.k1_N_per_Pa * contraction + self.k2_N_per_Pa) * contraction
        return pressure_Pa * (shape + self.k3_N_per_Pa) + self.k4_N
