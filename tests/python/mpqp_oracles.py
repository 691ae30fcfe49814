"""Judges of an explicit solution that share nothing with its solver: an online QP solver, the KKT
conditions fitted by non-negative least squares, and points placed where solvers err.
"""

from typing import Any

import daqp
import numpy as np
from eampc.mpqp import Problem, Region, Solution
from scipy.optimize import nnls


def online_solution(problem: Any, p: np.ndarray) -> np.ndarray | None:
    """U(p) of DAQP; None if it says that there is none."""
    return online_answer(problem, p)[0]


def online_answer(problem: Any, p: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """The same, and the rows with a multiplier."""
    right = problem.w + problem.S @ p
    U, _, exit_flag, info = daqp.solve(
        problem.H,
        problem.F @ p + problem.f,
        problem.G,
        right,
        np.full_like(right, -1e30),
        np.zeros(len(right), dtype=np.int32),
        primal_tol=1e-10,
        dual_tol=1e-12,
    )
    return U if exit_flag == 1 else None, np.flatnonzero(info["lam"] > 0.0)


def optimality_gap(problem: Problem, p: np.ndarray, U: np.ndarray) -> float:
    """How far U is from the optimum at p, from the KKT conditions: a violated row counts by its
    distance, a residual r of the gradient by |H⁻¹ r|.
    """
    norms = np.linalg.norm(problem.G, axis=1)
    real = norms > 0.0
    slack = (problem.w + problem.S @ p - problem.G @ U)[real] / norms[real]
    gradient = problem.H @ U + problem.F @ p + problem.f
    active = slack < 1e-7 * max(1.0, float(np.abs(U).max()))
    rows = problem.G[real][active] / norms[real][active, None]
    residual = gradient
    if len(rows):
        multipliers, _ = nnls(rows.T, -gradient, maxiter=100 * len(rows))
        residual = gradient + rows.T @ multipliers
    stationarity = float(np.linalg.norm(np.linalg.solve(problem.H, residual)))
    return max(stationarity, float(-slack.min(initial=0.0)))


def placed_points(solution: Solution, random: np.random.Generator, count: int) -> np.ndarray:
    """Points on facets, on their edges and vertices (rays from the interior, then within what was
    hit), and the corners of the box, (about count, np).
    """
    lower, upper = solution.problem.lower, solution.problem.upper
    dimension = len(lower)
    corners = np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(dimension, -1).T
    points = [corners[random.permutation(len(corners))[:32]]]
    total = len(points[0])
    while total < count:
        region = solution.regions[int(random.integers(len(solution.regions)))]
        points.append(_down_to_a_vertex(region, upper - lower, random))
        total += len(points[-1])
    return np.clip(np.vstack(points), lower, upper)


def _down_to_a_vertex(region: Region, width: np.ndarray, random: np.random.Generator) -> np.ndarray:
    p, tight, found = region.interior.copy(), [], []
    for _ in width:
        direction = random.normal(size=len(width)) * width
        if tight:
            plane = np.linalg.qr(region.facet_normals[tight].T)[0]
            direction -= plane @ (plane.T @ direction)
        speed = region.facet_normals @ direction
        slack = np.maximum(region.facet_offsets - region.facet_normals @ p, 0.0)
        speed[tight] = 0.0
        reach = np.full(len(speed), np.inf)
        ahead = speed > 1e-9 * np.linalg.norm(direction)
        reach[ahead] = slack[ahead] / speed[ahead]
        hit = int(np.argmin(reach))
        if not np.isfinite(reach[hit]):
            break
        p = p + reach[hit] * direction
        tight.append(hit)
        found.append(p)
    return np.array(found).reshape(-1, len(width))


def overlap_count(solution: Solution, p: np.ndarray, margin: float = 1e-7) -> int:
    """How many of the points lie in the interior of more than one region."""
    a = solution.arrays
    half_width = 0.5 * (solution.problem.upper - solution.problem.lower)
    # Distances in the box scaled to ±1.
    norms = np.linalg.norm(a["facet_normals"] * half_width, axis=1)
    excess = (p @ a["facet_normals"].T - a["facet_offsets"]) / norms
    worst = np.maximum.reduceat(excess, a["facet_first"][:-1], axis=1)
    return int(((worst < -margin).sum(axis=1) > 1).sum())
