"""The inner problem of min-max MPC: the disturbance sequence that makes given moves dearest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eampc import _core
from eampc.reproduce.min_max_problem import MinMaxProblem

Array = NDArray[np.float64]


class Worst(NamedTuple):
    """A vertex of Ω^N and what it adds to the cost of d = 0."""

    signs: Array  # (N,), d = d_max·signs
    excess: float


class WorstDisturbance:
    """max over d ∈ Ω^N of the cost, for moves that are given.

    With e = θ − y_r of d = 0 and d = d_max·s the cost rises by linear(e)·s + sᵀ quadratic s. That
    is convex in s, so a vertex of the box is the worst; `_core.worst_vertex` finds it exactly.
    """

    def __init__(self, problem: MinMaxProblem) -> None:
        angle_of_signs = problem.of_signs[:, 0]
        self._to_linear = 2.0 * problem.weight_angle * angle_of_signs.T
        self._quadratic = problem.weight_angle * angle_of_signs.T @ angle_of_signs

    def linear(self, angle_error: Array) -> Array:
        """(N,): the slope of the excess at s = 0 for θ_i − y_r, i = 1..N, without disturbance."""
        return self._to_linear @ angle_error

    @property
    def quadratic(self) -> Array:
        """(N, N), positive semidefinite."""
        return self._quadratic

    def at(self, angle_error: Array) -> Worst:
        """The worst vertex for θ_i − y_r, i = 1..N, without disturbance, (N,)."""
        signs, excess, _nodes = _core.worst_vertex(self.linear(angle_error), self._quadratic)
        return Worst(np.asarray(signs), excess)
