"""200 seeded degenerate mpQPs: the explicit solution against an online QP solver and the KKT
conditions, at random parameters and at points placed on facets, vertices and corners; no overlaps,
every facet accounted for.

EAMPC_MPQP_SEEDS sets how many problems, EAMPC_MPQP_SAMPLES the random parameters of each.
"""

import os

import numpy as np
import pytest
from eampc import mpqp
from eampc.mpqp import NotProvedError, Problem, Solution
from hypothesis import given, settings
from hypothesis import strategies as st
from mpqp_oracles import online_solution, optimality_gap, overlap_count, placed_points
from mpqp_problems import random_problem

SEEDS = int(os.environ.get("EAMPC_MPQP_SEEDS", "200"))
SAMPLES = int(os.environ.get("EAMPC_MPQP_SAMPLES", "1000"))
BATCH = 20
# Of the largest solution: DAQP stops at 1e-10 of a row, whose condition may be 1e3.
TOLERANCE = 1e-6
REFUSED: dict[int, str] = {}


def solved(problem: Problem, **options: int) -> Solution:
    return mpqp.solve(*problem[:6], (problem.lower, problem.upper), **options)


def check_against_online_solver(solution: Solution, p: np.ndarray) -> tuple[int, int]:
    """Asserts every row; returns how many had a solution and how many had none."""
    problem = solution.problem
    U = solution(p)
    scale = max(1.0, float(np.nanmax(np.abs(U), initial=0.0)))
    feasible = 0
    for row, mine in zip(p, U, strict=True):
        online = online_solution(problem, row)
        if np.isnan(mine).any():
            assert online is None or border_distance(solution, row) < 1e-7, (
                f"a hole at p = {row.tolist()}"
            )
            continue
        feasible += 1
        if online is None or np.abs(mine - online).max() > TOLERANCE * scale:
            # One of the two is wrong; the optimality conditions decide.
            gap = optimality_gap(problem, row, mine)
            assert gap < TOLERANCE * scale, f"{mine} is not optimal at p = {row.tolist()}: {gap}"
    return feasible, len(p) - feasible


def border_distance(solution: Solution, p: np.ndarray) -> float:
    """Distance, in the scaled box, to the nearest region."""
    a = solution.arrays
    half_width = 0.5 * (solution.problem.upper - solution.problem.lower)
    norms = np.linalg.norm(a["facet_normals"] * half_width, axis=1)
    excess = (a["facet_normals"] @ p - a["facet_offsets"]) / norms
    return float(np.maximum.reduceat(excess, a["facet_first"][:-1]).min())


def check_facets(solution: Solution) -> None:
    """Every facet has neighbours or a reason to have none, and neighbours know each other."""
    for r, region in enumerate(solution.regions):
        for kind, neighbours in zip(region.facet_kinds, region.neighbours, strict=True):
            assert (kind == "inner") == bool(neighbours), (r, kind, neighbours)
            for other in neighbours:
                assert any(r in back for back in solution.regions[other].neighbours), (r, other)


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("first", range(0, SEEDS, BATCH))
def test_no_random_problem_is_solved_wrongly(first: int) -> None:
    for seed in range(first, min(first + BATCH, SEEDS)):
        problem = random_problem(seed)
        try:
            solution = solved(problem, threads=1)
        except NotProvedError as refusal:
            REFUSED[seed] = str(refusal)
            continue
        random = np.random.default_rng(1000 + seed)
        p = random.uniform(problem.lower, problem.upper, size=(SAMPLES, len(problem.lower)))
        feasible, _ = check_against_online_solver(solution, p)
        assert feasible > 0
        check_against_online_solver(solution, placed_points(solution, random, SAMPLES // 4))
        assert overlap_count(solution, p) == 0, f"seed {seed}"
        if solution.statistics["flat_regions_dropped"] == 0:
            check_facets(solution)
    assert len(REFUSED) <= SEEDS // 100, REFUSED
    assert all("rounding hides which rows are active" in reason for reason in REFUSED.values())


def test_random_problems_are_as_difficult_as_they_claim() -> None:
    infeasible = flat = inputs = 0
    for seed in range(40):
        problem = random_problem(seed)
        statistics = solved(problem, threads=1).statistics
        infeasible += statistics["has_infeasible_parameters"]
        flat += statistics["flat_active_sets"] > 0
        inputs = max(inputs, len(problem.f))
        assert statistics["rows_kept"] < statistics["rows_given"] - 4, "rows are redundant"
    assert infeasible > 10
    assert flat > 10
    assert inputs > 5


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**31 - 1),
    st.integers(1, 3),
    st.integers(1, 3),
    st.lists(st.sampled_from([-2.0, -1.0, 0.0, 1.0, 2.0]), min_size=40, max_size=40),
)
def test_small_integer_problems_are_optimal(
    seed: int, n: int, count: int, entries: list[float]
) -> None:
    """Rows of small integers: dependent, parallel and coincident ones at will."""
    values = iter(entries)
    rows = 4
    G = np.array([[next(values) for _ in range(n)] for _ in range(rows)])
    S = np.array([[next(values) for _ in range(count)] for _ in range(rows)])
    random = np.random.default_rng(seed)
    F = random.integers(-2, 3, (n, count)).astype(float)
    w = random.integers(1, 4, rows).astype(float)
    box = np.ones(count)
    solution = mpqp.solve(np.eye(n), F, np.zeros(n), G, w, S, (-box, box), threads=1)
    p = random.uniform(-box, box, size=(100, count))
    check_against_online_solver(solution, np.vstack([p, placed_points(solution, random, 40)]))
    assert overlap_count(solution, p) == 0
