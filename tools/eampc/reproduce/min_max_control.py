"""Min-max MPC, step by step: scenario generation over an epigraph, by Clarabel.

    minimise over x, U, s, t   Σ Q (θ_i − y_r)² + Σ R u_i² + c1 s + c2 s² + t
    subject to   the dynamics and bounds of d = 0 (the state bounds moved in),
                 t ≥ excess(U, v) for every vertex v of Ω^N found so far

All costs share their quadratic part in U, so each vertex is one linear row, and the largest is
found exactly (worst_disturbance). A vertex that is dearer than t joins, until none is: U is then
optimal against every vertex, hence against all of Ω^N.

What makes it quick: states kept as variables (Clarabel factorises a banded system, half the time of
the condensed one), vertices kept from step to step (one solution per step is the rule, as
neighbouring states have the same worst ones), solvers kept per set of vertices with only the right
side replaced, and no iterative refinement (the solver's stopping test is unchanged).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eampc.errors import RunFailed, UserError
from eampc.reproduce.min_max_problem import MinMaxProblem
from eampc.reproduce.worst_disturbance import Worst, WorstDisturbance

try:
    import clarabel
    from scipy import sparse
except ImportError as error:
    raise UserError(
        f"min-max MPC needs the package {error.name}; install eampc[reproduce], or clarabel and "
        "scipy by pip"
    ) from None

Array = NDArray[np.float64]

# The cost is flat in u, because R is small: Clarabel's own 1e-8 leaves 1e-4 of the range of u open,
# this one less than 1e-6, for a tenth more time.
_GAP_TOLERANCE = 1e-10
# A vertex joins if it exceeds t by more than this share of the excess.
_EXCESS_TOLERANCE = 1e-7
# A vertex leaves after this many steps without being active or worst, and may come again.
_MEMORY_STEPS = 10
# Solvers kept: more sets of vertices than a run of 10 s meets.
_KEPT_SOLVERS = 64
# What counts as an active row.
_ACTIVE_MULTIPLIER = 1e-6


@dataclass(frozen=True)
class MinMaxStep:
    """One decision."""

    control: float  # u, in units of the control
    moves: Array  # (m,)
    slack: float  # relative violation of the state bounds, 0 where they can be kept
    worst: Worst  # the dearest vertex for these moves
    epigraph: float  # t: the worst excess as the solver sees it
    vertices: Array  # (k, N), the rows of the epigraph
    solutions: int  # quadratic programs solved
    solver_s: float  # processor time inside Clarabel


class MinMaxControl:
    """The controller: state (θ, θ̇) in, u out. Keeps vertices and solvers between steps."""

    def __init__(self, problem: MinMaxProblem) -> None:
        self.problem = problem
        self._worst = WorstDisturbance(problem)
        self._epigraph = _Epigraph(problem, self._worst)
        ones = np.ones(problem.horizon)
        # All one way is the worst for any error that keeps its sign.
        self._vertices: dict[bytes, tuple[Array, int]] = {}
        if problem.disturbance_max_rad_s2 > 0.0:
            self._vertices = {v.tobytes(): (v, 0) for v in (ones, -ones)}
        self._steps = 0

    def step(self, state: Array) -> MinMaxStep:
        """The exact solution at a measured state (rad, rad/s)."""
        state = np.asarray(state, dtype=float)
        self._steps += 1
        solutions, solver_s = 0, 0.0
        while True:
            vertices = [vertex for vertex, _ in self._vertices.values()]
            started = time.thread_time()
            moves, slack, epigraph, multipliers = self._epigraph.solve(state, vertices)
            solver_s += time.thread_time() - started
            solutions += 1
            angles = self.problem.undisturbed_angles(state, moves)
            worst = self._worst.at(angles - self.problem.reference_rad)
            key = worst.signs.tobytes()
            for known, multiplier in zip(list(self._vertices), multipliers, strict=True):
                if multiplier > _ACTIVE_MULTIPLIER or known == key:
                    self._vertices[known] = (self._vertices[known][0], self._steps)
            if key in self._vertices or worst.excess <= epigraph + _EXCESS_TOLERANCE * worst.excess:
                break
            self._vertices[key] = (worst.signs, self._steps)
        self._forget()
        limit = self.problem.control_max
        return MinMaxStep(
            control=float(np.clip(moves[0], -limit, limit)),
            moves=moves,
            slack=slack,
            worst=worst,
            epigraph=epigraph,
            vertices=np.array(vertices).reshape(-1, self.problem.horizon),
            solutions=solutions,
            solver_s=solver_s,
        )

    def _forget(self) -> None:
        oldest = self._steps - _MEMORY_STEPS
        if any(used < oldest for _, used in self._vertices.values()):
            self._vertices = {k: v for k, v in self._vertices.items() if v[1] >= oldest}


class _Epigraph:
    """The quadratic program over (x_1 .. x_N, U, s, t) for a set of vertices."""

    def __init__(self, problem: MinMaxProblem, worst: WorstDisturbance) -> None:
        self._problem, self._worst = problem, worst
        N, m = problem.horizon, problem.moves
        self._at_moves, self._at_slack, self._at_t = 2 * N, 2 * N + m, 2 * N + m + 1
        self._size = self._at_t + 1
        held = np.bincount(np.minimum(np.arange(N), m - 1), minlength=m)
        curvature = np.zeros(self._size)
        curvature[0 : 2 * N : 2] = 2.0 * problem.weight_angle
        curvature[self._at_moves : self._at_slack] = 2.0 * problem.weight_control * held
        curvature[self._at_slack] = 2.0 * problem.slack_quadratic
        self._curvature = sparse.diags(curvature).tocsc()
        self._slope = np.zeros(self._size)
        self._slope[0 : 2 * N : 2] = -2.0 * problem.weight_angle * problem.reference_rad
        self._slope[self._at_slack] = problem.slack_linear
        self._slope[self._at_t] = 1.0
        self._rows, self._right_side = self._constant_rows()
        self._settings = clarabel.DefaultSettings()
        self._settings.verbose = False
        self._settings.presolve_enable = False  # it would forbid new data
        self._settings.iterative_refinement_enable = False
        self._settings.tol_gap_abs = self._settings.tol_gap_rel = _GAP_TOLERANCE
        self._solvers: dict[tuple[bytes, ...], tuple[clarabel.DefaultSolver, Array]] = {}

    def solve(self, state: Array, vertices: list[Array]) -> tuple[Array, float, float, Array]:
        """(moves, slack, t, multiplier of each vertex)."""
        solver, right_side = self._solver(vertices)
        right_side[:2] = self._problem.A_star @ state
        solver.update(b=right_side)
        solution = solver.solve()
        if str(solution.status) not in ("Solved", "AlmostSolved"):
            raise RunFailed(
                f"min-max MPC found no solution at the state {state.tolist()} "
                f"({solution.status}); the problem always has one, so its numbers must be out of "
                "scale: look at [constraints] and the weights"
            )
        z = np.array(solution.x)
        multipliers = np.array(solution.z[len(right_side) - len(vertices) :])
        moves = z[self._at_moves : self._at_slack]
        return moves, float(z[self._at_slack]), float(z[self._at_t]), multipliers

    def _solver(self, vertices: list[Array]) -> tuple[clarabel.DefaultSolver, Array]:
        key = tuple(vertex.tobytes() for vertex in vertices)
        if key not in self._solvers:
            if len(self._solvers) >= _KEPT_SOLVERS:
                self._solvers.pop(next(iter(self._solvers)))
            rows = sparse.vstack([self._rows, *map(self._vertex_row, vertices)]).tocsc()
            bounds = [*self._right_side, *map(self._vertex_bound, vertices)]
            equalities = 2 * self._problem.horizon
            cones = [
                clarabel.ZeroConeT(equalities),
                clarabel.NonnegativeConeT(len(bounds) - equalities),
            ]
            right_side = np.array(bounds)
            solver = clarabel.DefaultSolver(
                self._curvature, self._slope, rows, right_side, cones, self._settings
            )
            self._solvers[key] = solver, right_side
        return self._solvers[key]

    def _constant_rows(self) -> tuple[sparse.csc_matrix, Array]:
        """Dynamics, input bounds, state bounds, s ≥ 0, and t ≥ 0: of v and −v one adds cost."""
        problem, N, m = self._problem, self._problem.horizon, self._problem.moves
        dynamics = np.zeros((2 * N, self._size))
        states = np.zeros((2 * N, self._size))
        for i in range(N):
            rows = slice(2 * i, 2 * i + 2)
            dynamics[rows, rows] = np.eye(2)
            if i > 0:
                dynamics[rows, 2 * i - 2 : 2 * i] = -problem.A_star
            dynamics[rows, self._at_moves + min(i, m - 1)] = -problem.B_star
            states[rows, rows] = np.diag(1.0 / problem.state_bounds[i])
        inputs = np.zeros((m, self._size))
        inputs[:, self._at_moves : self._at_slack] = np.eye(m)
        slack = np.zeros((1, self._size))
        slack[0, self._at_slack] = -1.0
        t = np.zeros((1, self._size))
        t[0, self._at_t] = -1.0
        lower, upper = -states + slack, states + slack
        limit = np.full(2 * m, problem.control_max)
        one = np.ones(4 * N)
        matrix = np.vstack([dynamics, inputs, -inputs, upper, lower, slack, t])
        return sparse.csc_matrix(matrix), np.concatenate([np.zeros(2 * N), limit, one, [0.0, 0.0]])

    def _vertex_row(self, signs: Array) -> sparse.csc_matrix:
        """linear(θ − y_r)·signs + signsᵀ quadratic signs ≤ t, its left side."""
        row = np.zeros((1, self._size))
        row[0, 0 : 2 * self._problem.horizon : 2] = self._of_angles(signs)
        row[0, self._at_t] = -1.0
        return sparse.csc_matrix(row)

    def _vertex_bound(self, signs: Array) -> float:
        constant = signs @ self._worst.quadratic @ signs
        return float(self._problem.reference_rad * self._of_angles(signs).sum() - constant)

    def _of_angles(self, signs: Array) -> Array:
        """(N,): the slope of linear(·)·signs in the angles."""
        problem = self._problem
        return 2.0 * problem.weight_angle * problem.of_signs[:, 0] @ signs
