"""The programs of a min-max run once more, by the active-set solver DAQP: how much of the ratio is
the choice of solver, and whether another solver agrees.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eampc.reproduce.min_max_control import MinMaxStep
from eampc.reproduce.min_max_problem import MinMaxProblem
from eampc.reproduce.worst_disturbance import WorstDisturbance

Array = NDArray[np.float64]

_NO_BOUND = 1e30
# DAQP wants a strictly convex program, and t has no curvature; this little moves nothing.
_CURVATURE_OF_T = 1e-7


class PeerTimes(NamedTuple):
    """One program per step: that of the step's vertices."""

    mean_s: float  # processor time of set-up and solution, forming the data not counted
    largest_difference: float  # of u from the controller's


def active_set_times(
    problem: MinMaxProblem, states: Array, steps: Sequence[MinMaxStep]
) -> PeerTimes | None:
    """Over the steps of a run at states (n, 2); None where DAQP is not installed."""
    try:
        import daqp
    except ImportError:
        return None
    program = _CondensedProgram(problem)
    total_s, largest = 0.0, 0.0
    for state, step in zip(states, steps, strict=True):
        data = program.data(state, step.vertices)
        started = time.thread_time()
        solution, _, exit_flag, _ = daqp.solve(*data)
        total_s += time.thread_time() - started
        difference = abs(solution[0] - step.control) if exit_flag == 1 else np.inf
        largest = max(largest, float(difference))
    return PeerTimes(total_s / len(steps), largest)


class _CondensedProgram:
    """min over (U, s, t), the states eliminated: an active-set solver likes few variables."""

    def __init__(self, problem: MinMaxProblem) -> None:
        self._problem, self._worst = problem, WorstDisturbance(problem)
        m, N = problem.moves, problem.horizon
        self._angles = problem.of_moves[:, 0]
        held = np.bincount(np.minimum(np.arange(N), m - 1), minlength=m)
        self._hessian = np.zeros((m + 2, m + 2))
        self._hessian[:m, :m] = 2.0 * (
            problem.weight_angle * self._angles.T @ self._angles
            + problem.weight_control * np.diag(held)
        )
        self._hessian[m, m] = 2.0 * problem.slack_quadratic
        self._hessian[m + 1, m + 1] = _CURVATURE_OF_T
        states = (problem.of_moves / problem.state_bounds[:, :, None]).reshape(2 * N, m)
        self._state_rows = np.zeros((4 * N, m + 2))
        self._state_rows[:, :m] = np.vstack([states, -states])
        self._state_rows[:, m] = -1.0

    def data(self, state: Array, vertices: Array) -> tuple[Array, ...]:
        """H, f, A, upper, lower, sense; the first rows are bounds on (U, s, t)."""
        problem, m = self._problem, self._problem.moves
        free = problem.of_state @ state
        error = free[:, 0] - problem.reference_rad
        slope = 2.0 * problem.weight_angle * self._angles.T @ error
        relative = (free / problem.state_bounds).ravel()
        rows = np.zeros((len(vertices), m + 2))
        excess = np.zeros(len(vertices))
        for k, vertex in enumerate(vertices):
            of_angles = 2.0 * problem.weight_angle * problem.of_signs[:, 0] @ vertex
            rows[k, :m] = self._angles.T @ of_angles
            rows[k, m + 1] = -1.0
            excess[k] = error @ of_angles + vertex @ self._worst.quadratic @ vertex
        limit = np.full(m, problem.control_max)
        upper = np.concatenate([limit, [_NO_BOUND] * 2, 1.0 - relative, 1.0 + relative, -excess])
        lower = np.full(len(upper), -_NO_BOUND)
        lower[: m + 2] = np.concatenate([-limit, [0.0, 0.0]])
        return (
            self._hessian,
            np.concatenate([slope, [problem.slack_linear, 1.0]]),
            np.vstack([self._state_rows, rows]),
            upper,
            lower,
            np.zeros(len(upper), dtype=np.int32),
        )
