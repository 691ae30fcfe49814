"""QP solvers on the parameters of a benchmark: nanoseconds per point, and the first input found.

What is counted, per point: DAQP is called as its C library from C++, the time is that of the linear
term and the bounds from p, their update, and the solve. The others are called from Python; their
time is what they report of themselves, update and solve, so that no Python is in it (OSQP and PIQP
do not count what computes the linear term from p; Clarabel neither that nor the update).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eampc.benchmark.machine import version
from eampc.benchmark.problems import Array, BenchmarkProblem, BoundedForm
from eampc.errors import UserError

# The C structures that tools/law_design/daqp_timing.cpp knows.
DAQP_VERSION = "0.11."
# Of a simulation at 1e-5 rad nobody sees more; the solvers' own defaults are 1e-3 to 1e-8.
OSQP_TOLERANCE = 1e-5
# Whole sweeps over the points, of which each point's least time counts: a solver that starts from
# its last solution must not start from this point's own.
SWEEPS = 3


@dataclass(frozen=True)
class PeerTiming:
    """One entry per point: nanoseconds, and the output y; NaN where the solver failed."""

    name: str
    counted: str
    point_ns: Array
    y: Array


def require_peers(names: tuple[str, ...]) -> None:
    """UserError, one sentence, if a package is missing."""
    for name in names:
        try:
            importlib.import_module(name)
        except ImportError:
            raise UserError(
                f"the benchmark's peer {name} is not installed; pip install 'eampc[bench]'"
            ) from None
    if not (version("daqp") or "").startswith(DAQP_VERSION):
        raise UserError(
            f"daqp {version('daqp')} has another C interface than {DAQP_VERSION}x, which is timed "
            "here; pip install 'eampc[bench]'"
        )


def feasible(problem: BenchmarkProblem, form: BoundedForm, points: Array) -> Array:
    """Which of the points (k, np) have a solution, by DAQP: (k,) of bool."""
    return _daqp(problem, form, points, warm=False, repetitions=1)["exit_flags"] > 0


def daqp(
    problem: BenchmarkProblem, form: BoundedForm, points: Array, *, warm: bool, how: str
) -> PeerTiming:
    """DAQP in C, prepared: cold, or each point from the working set of the one before."""
    result = _daqp(problem, form, points, warm=warm, repetitions=SWEEPS)
    y = _output(problem, result["U"], points)
    y[result["exit_flags"] <= 0] = np.nan
    return PeerTiming(f"DAQP, {how}", "C call: bounds from p, update, solve", result["point_ns"], y)


def osqp(problem: BenchmarkProblem, form: BoundedForm, points: Array) -> PeerTiming:
    """OSQP with its own warm start, updated and solved point by point."""
    import osqp as package
    from scipy import sparse

    of = problem.problem
    rows = _rows(form, of.H.shape[0])
    solver = package.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(of.H)),
        of.F @ points[0] + of.f,
        sparse.csc_matrix(rows),
        *_bounds(form, points[0]),
        eps_abs=OSQP_TOLERANCE,
        eps_rel=OSQP_TOLERANCE,
        max_iter=20_000,
        verbose=False,
    )

    def solve(p: Array) -> tuple[float, Array | None]:
        lower, upper = _bounds(form, p)
        solver.update(q=of.F @ p + of.f, l=lower, u=upper)
        result = solver.solve(raise_error=False)
        solved = result.info.status_val == package.SolverStatus.OSQP_SOLVED
        return result.info.update_time + result.info.solve_time, result.x if solved else None

    return _each(
        problem, points, f"OSQP, {OSQP_TOLERANCE:g}", "its own time: update and solve", solve
    )


def piqp(problem: BenchmarkProblem, form: BoundedForm, points: Array) -> PeerTiming:
    """PIQP's dense solver, updated and solved point by point."""
    import piqp as package

    of = problem.problem
    n = of.H.shape[0]
    simple = len(form.upper_offset) - len(form.A)
    solver = package.DenseSolver()
    solver.settings.compute_timings = True
    general = np.asfortranarray(_rows(form, n)[simple:])

    def data(p: Array) -> dict[str, Array]:
        lower, upper = _bounds(form, p)
        box = {"x_l": lower[:simple], "x_u": upper[:simple]} if simple else {}
        return {"c": of.F @ p + of.f, "h_l": lower[simple:], "h_u": upper[simple:], **box}

    solver.setup(P=np.asfortranarray(of.H), G=general, **data(points[0]))

    def solve(p: Array) -> tuple[float, Array | None]:
        solver.update(**data(p))
        status = solver.solve()
        info = solver.result.info
        x = solver.result.x.copy() if status == package.PIQP_SOLVED else None
        return info.update_time + info.solve_time, x

    return _each(problem, points, "PIQP, dense", "its own time: update and solve", solve)


def clarabel(problem: BenchmarkProblem, form: BoundedForm, points: Array) -> PeerTiming:
    """Clarabel, its data updated, solved point by point."""
    import clarabel as package
    from scipy import sparse

    of = problem.problem
    rows = _rows(form, of.H.shape[0])
    one_sided = np.isinf(form.lower_offset)
    A = np.vstack([rows, -rows[~one_sided]])

    def bounds(p: Array) -> Array:
        lower, upper = _bounds(form, p)
        return np.concatenate([upper, -lower[~one_sided]])

    settings = package.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False  # else the data cannot be updated
    solver = package.DefaultSolver(
        sparse.csc_matrix(np.triu(of.H)),
        of.F @ points[0] + of.f,
        sparse.csc_matrix(A),
        bounds(points[0]),
        [package.NonnegativeConeT(len(A))],
        settings,
    )

    def solve(p: Array) -> tuple[float, Array | None]:
        solver.update(q=of.F @ p + of.f, b=bounds(p))
        solution = solver.solve()
        solved = solution.status == package.SolverStatus.Solved
        return solution.solve_time, np.asarray(solution.x) if solved else None

    return _each(problem, points, "Clarabel", "its own time: solve", solve)


def _daqp(
    problem: BenchmarkProblem, form: BoundedForm, points: Array, *, warm: bool, repetitions: int
) -> dict[str, Any]:
    from eampc import _core

    package = importlib.import_module("daqp")
    of = problem.problem
    return _core.time_daqp(
        package.__file__,
        of.H,
        of.F,
        of.f,
        form.A,
        form.lower_gain,
        form.lower_offset,
        form.upper_gain,
        form.upper_offset,
        points,
        warm=warm,
        repetitions=repetitions,
    )


def _each(
    problem: BenchmarkProblem,
    points: Array,
    name: str,
    counted: str,
    solve: Callable[[Array], tuple[float, Array | None]],
) -> PeerTiming:
    least = np.full(len(points), np.inf)
    inputs = np.full((len(points), problem.problem.H.shape[0]), np.nan)
    for _ in range(SWEEPS):
        for k, p in enumerate(points):
            seconds, U = solve(p)
            least[k] = min(least[k], 1e9 * seconds)
            inputs[k] = np.nan if U is None else U
    return PeerTiming(name, counted, least, _output(problem, inputs, points))


def _output(problem: BenchmarkProblem, U: Array, points: Array) -> Array:
    y = U @ problem.output_U + points @ problem.output_p + problem.output_offset
    return np.clip(y, problem.y_min, problem.y_max)


def _rows(form: BoundedForm, n: int) -> Array:
    simple = len(form.upper_offset) - len(form.A)
    return np.vstack([np.eye(n)[:simple], form.A])


def _bounds(form: BoundedForm, p: Array) -> tuple[Array, Array]:
    return form.lower_gain @ p + form.lower_offset, form.upper_gain @ p + form.upper_offset
