"""The explicit law against an online QP solver (DAQP), on every ready rig: at random parameters,
and on facets, their edges and vertices, and the corners of the box.

EAMPC_LAW_SAMPLES sets the number of random parameters per rig (5,000 by default; a fifth as many
are placed on purpose), EAMPC_LAW_SEED the seed. A million takes some minutes per rig:

    EAMPC_LAW_SAMPLES=1000000 .venv/bin/python -m pytest -s tests/python/test_law_against_qp.py
"""

import os
from functools import cache

import numpy as np
import pytest
from eampc import mpqp
from eampc.law import Law, Problem
from exact_qp import exact_solution
from mpqp_oracles import online_answer, online_solution, placed_points
from ready_rigs import READY, law_of

SAMPLES = int(os.environ.get("EAMPC_LAW_SAMPLES", "5000"))
SEED = int(os.environ.get("EAMPC_LAW_SEED", "1"))
# Of the range of the control.
TOLERANCE = 1e-9
# A second per hundred parameters, however loaded the machine is.
LIMIT_S = 1200 + SAMPLES // 100


def sampled_parameters(law: Law, count: int, seed: int) -> np.ndarray:
    """Half uniform in the box, a quarter near its centre, a quarter on its faces and corners."""
    random = np.random.default_rng(seed)
    p = random.uniform(law.lower, law.upper, size=(count, len(law.lower)))
    quarter = count // 4
    p[:quarter] *= random.uniform(0.0, 0.3, size=(quarter, 1))
    faces = p[quarter : 2 * quarter]
    outward = np.where(faces > 0.0, law.upper, law.lower)
    p[quarter : 2 * quarter] = np.where(random.random(faces.shape) < 0.4, outward, faces)
    return p


@cache
def regions_of(name: str, variant: str | None) -> mpqp.Solution:
    """The critical regions of a rig's problem."""
    problem = law_of(name, variant).problem
    return mpqp.solve(*problem[:6], (problem.lower, problem.upper))


def control(problem: Problem, p: np.ndarray, U: np.ndarray) -> np.ndarray:
    """The control of solutions, not clipped; p and U may be rows."""
    return U @ problem.output_U + p @ problem.output_p + problem.output_offset


def exact_control(law: Law, solution: mpqp.Solution, p: np.ndarray) -> float:
    """By rational arithmetic; the rows to try first are DAQP's and those of regions near p."""
    problem = law.problem
    U, active = online_answer(problem, p)
    assert U is not None
    half_width = 0.5 * (problem.upper - problem.lower)
    guesses = [active.tolist()]
    for region in solution.regions:
        distance = region.facet_normals @ p - region.facet_offsets
        distance /= np.linalg.norm(region.facet_normals * half_width, axis=1)
        if distance.max(initial=-1.0) < 1e-6:
            guesses.append(list(region.active_set))
    slack = (problem.w + problem.S @ p - problem.G @ U) / np.linalg.norm(problem.G, axis=1)
    exact = exact_solution(problem, p, guesses, np.flatnonzero(slack < 1e-6).tolist())
    assert exact is not None, p.tolist()
    return float(control(problem, p, np.array([float(x) for x in exact])))


def check(name: str, variant: str | None, p: np.ndarray, what: str, tolerance: float) -> None:
    law, solution = law_of(name, variant), regions_of(name, variant)
    u_min, u_max = law.control_range
    assert not np.isnan(solution(p)).any(), "a parameter of the box has no region"
    u, piece = law.evaluate(p, regions=True)
    assert piece.min() >= 0, "a parameter of the box has no piece"
    expected = np.empty(len(p))
    for i, row in enumerate(p):
        U = online_solution(law.problem, row)
        assert U is not None, f"the QP has no solution at p = {row.tolist()}"
        expected[i] = control(law.problem, row, U)
    error = np.abs(u - np.clip(expected, u_min, u_max)) / (u_max - u_min)
    doubtful = np.flatnonzero(error > TOLERANCE)
    largest = error.max()
    for i in doubtful:
        expected[i] = exact_control(law, solution, p[i])
        error[i] = abs(u[i] - np.clip(expected[i], u_min, u_max)) / (u_max - u_min)
    worst = int(error.argmax())
    print(
        f"{name}, {variant or 'as it is'}, {len(p)} {what} parameters: no holes, error at most "
        f"{error[worst]:.2g} of the range, above {TOLERANCE} at {int((error > TOLERANCE).sum())} "
        f"(against DAQP alone {largest:.2g}, at {len(doubtful)})"
    )
    assert error[worst] <= tolerance, (
        f"law {u[worst]}, QP {expected[worst]} at p = {p[worst].tolist()} (seed {SEED})"
    )


@pytest.mark.timeout(LIMIT_S)
@pytest.mark.parametrize(("name", "variant"), READY)
def test_law_is_the_solution_of_its_problem(name: str, variant: str | None) -> None:
    check(
        name, variant, sampled_parameters(law_of(name, variant), SAMPLES, SEED), "random", TOLERANCE
    )


@pytest.mark.timeout(LIMIT_S)
@pytest.mark.parametrize(("name", "variant"), READY)
def test_law_holds_on_facets_vertices_and_corners(name: str, variant: str | None) -> None:
    """Where rounding decides the side of a hyperplane: as near as the certificate says."""
    figures = law_of(name, variant).payload["law"]["certificate"]
    tolerance = TOLERANCE + figures["edge_error"] + figures["sliver_error"]
    random = np.random.default_rng(SEED + 2)
    p = placed_points(regions_of(name, variant), random, SAMPLES // 5)
    check(name, variant, p, "placed", tolerance)


@pytest.mark.parametrize(("name", "variant"), READY)
def test_price_of_a_violation_is_exact(name: str, variant: str | None) -> None:
    """Where the hard problem has a solution, the softened one has the same."""
    law = law_of(name, variant)
    problem = law.problem
    slack = problem.H.shape[0] - 1
    hard = Problem(
        np.ascontiguousarray(problem.H[:slack, :slack]),
        problem.F[:slack],
        problem.f[:slack],
        np.ascontiguousarray(problem.G[:-1, :slack]),
        problem.w[:-1],
        problem.S[:-1],
        problem.lower,
        problem.upper,
        problem.output_U[:slack],
        problem.output_p,
        problem.output_offset,
    )
    u_min, u_max = law.control_range
    compared = 0
    for p in sampled_parameters(law, 800, SEED + 1):
        U = online_solution(hard, p)
        if U is None:
            continue
        expected = np.clip(control(hard, p, U), u_min, u_max)
        assert abs(law.evaluate(p) - expected) < 1e-5 * (u_max - u_min), p.tolist()
        compared += 1
    assert compared > 100


def test_clamps_onto_the_box_as_the_daemon_does() -> None:
    law = law_of("reference")
    outside = 3.0 * law.upper
    assert law.evaluate(outside) == law.evaluate(law.upper)
    with pytest.raises(ValueError, match="angle_error, velocity_error"):
        law.evaluate([1.0, 2.0])
