"""Min-max MPC of the joint as data: model, horizon, weights and bounds of a rig's law, and Ω.

    min over U, s   max over d ∈ Ω^N   Σ_{i=0..N} Q (θ_i − y_r)² + Σ_{i<N} R u_i² + c1 s + c2 s²
    x_{i+1} = A* x_i + B* u_i + D (0, d_i)ᵀ,   |u_i| ≤ u_max,
    |θ_i| ≤ θ_max (1 + s), |θ̇_i| ≤ θ̇_max (1 + s) for every d ∈ Ω^N,   s ≥ 0

It is the open-loop form: one U against every disturbance. Ω = [−d_max, d_max] is the rig's stated
bound on d, `tightening.disturbance_max_rad_s2`, which the adaptive controller's tightening assumes
too; it holds through one period, as u does. Nothing is known of ḋ here and nothing is estimated.
Cost, horizon, bounds and the price of a violated state bound are those of the rig's `paper` law.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eampc.errors import DesignError

if TYPE_CHECKING:
    from eampc_rig import Rig

    from eampc.law import Law

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MinMaxProblem:
    """Numbers of the problem; N stages, m ≤ N free moves, the last of them held."""

    A_star: Array  # (2, 2)
    B_star: Array  # (2,)
    disturbance_column: Array  # (2,), the column of D for d on θ̇
    horizon: int
    moves: int
    weight_angle: float  # Q, per rad²
    weight_control: float  # R, per unit² of u
    reference_rad: float
    angle_max_rad: float
    velocity_max_rad_s: float
    control_max: float
    slack_linear: float
    slack_quadratic: float
    disturbance_max_rad_s2: float

    @classmethod
    def of_rig(cls, rig: Rig, law: Law) -> MinMaxProblem:
        """The counterpart of the rig's law, with the law's own sampled model.

        Raises DesignError if the rig's formulation is not `paper` or no bound on d is stated.
        """
        control, limits = rig.control, rig.constraints
        if control.formulation != "paper" or control.reference_rad is None:
            raise DesignError(
                f"{rig.file}: min-max MPC is the counterpart of the formulation paper with a fixed "
                'reference; set control.formulation = "paper" and control.reference_rad'
            )
        bound = rig.tightening.disturbance_max_rad_s2
        if bound is None:
            raise DesignError(
                f"{rig.file}: min-max MPC needs a bound on the disturbance; set "
                "tightening.disturbance_max_rad_s2"
            )
        model = law.payload["model"]
        problem = cls(
            A_star=np.asarray(model["A_star"], dtype=float),
            B_star=np.asarray(model["B_star"], dtype=float).reshape(-1),
            disturbance_column=np.asarray(model["D"], dtype=float)[:, 1].copy(),
            horizon=control.horizon,
            moves=control.control_horizon,
            weight_angle=control.weight_angle,
            weight_control=control.weight_control,
            reference_rad=control.reference_rad,
            angle_max_rad=limits.angle_max_rad,
            velocity_max_rad_s=limits.velocity_max_rad_s,
            control_max=rig.control_max,
            slack_linear=limits.slack_linear,
            slack_quadratic=limits.slack_quadratic,
            disturbance_max_rad_s2=bound,
        )
        if problem.state_bounds.min() <= 0.0:
            raise DesignError(
                f"{rig.file}: a disturbance of {bound:g} rad/s2 leaves min-max MPC no room within "
                "the state bounds; shorten control.horizon or widen [constraints]"
            )
        return problem

    @cached_property
    def of_state(self) -> Array:
        """(N, 2, 2): x_i = of_state[i − 1] x_0 without inputs, i = 1..N."""
        return np.array([np.linalg.matrix_power(self.A_star, i + 1) for i in range(self.horizon)])

    @cached_property
    def of_moves(self) -> Array:
        """(N, 2, m): what the moves add to x_i."""
        held = np.zeros((self.horizon, self.moves))
        held[np.arange(self.horizon), np.minimum(np.arange(self.horizon), self.moves - 1)] = 1.0
        return self._convolution(self.B_star) @ held

    @cached_property
    def of_signs(self) -> Array:
        """(N, 2, N): what d = d_max·signs adds to x_i."""
        return self.disturbance_max_rad_s2 * self._convolution(self.disturbance_column)

    @cached_property
    def state_bounds(self) -> Array:
        """(N, 2): bounds on the undisturbed θ_i, θ̇_i that keep every disturbed one within its own.

        Exact: of all d ∈ Ω^N, the one whose signs are those of the row of `of_signs` moves the
        state furthest. It is exact for every d(t) within Ω, not only for those held through a
        period, where the responses of θ and θ̇ to d keep their sign within a period.
        """
        outer = np.array([self.angle_max_rad, self.velocity_max_rad_s])
        return outer - np.abs(self.of_signs).sum(axis=2)

    def undisturbed_angles(self, state: Array, moves: Array) -> Array:
        """θ_1 .. θ_N, (N,), from state (θ, θ̇) under moves (m,) with d = 0."""
        return self.of_state[:, 0] @ state + self.of_moves[:, 0] @ moves

    def cost(self, state: Array, moves: Array, disturbance: Array) -> float:
        """Tracking and control cost of one disturbance sequence (N,) in rad/s², by simulation."""
        x, total = np.asarray(state, dtype=float), 0.0
        for i in range(self.horizon):
            u = moves[min(i, self.moves - 1)]
            total += self.weight_angle * (x[0] - self.reference_rad) ** 2
            total += self.weight_control * u**2
            x = self.A_star @ x + self.B_star * u + self.disturbance_column * disturbance[i]
        return float(total + self.weight_angle * (x[0] - self.reference_rad) ** 2)

    def _convolution(self, column: Array) -> Array:
        """(N, 2, N): the response of x_1 .. x_N to an input on `column` in each period."""
        response = np.zeros((self.horizon, 2, self.horizon))
        impulse = column
        for delay in range(self.horizon):
            stages = np.arange(delay, self.horizon)
            response[stages, :, stages - delay] = impulse
            impulse = self.A_star @ impulse
        return response
