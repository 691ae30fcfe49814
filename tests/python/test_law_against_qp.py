"""The explicit law against an online QP solver (DAQP), at random parameters of every ready rig.

EAMPC_LAW_SAMPLES sets the number of parameters per rig (5,000 by default), EAMPC_LAW_SEED the seed.
"""

import os

import daqp
import numpy as np
import pytest
from eampc.law import Law, Problem
from ready_rigs import READY, law_of

SAMPLES = int(os.environ.get("EAMPC_LAW_SAMPLES", "5000"))
SEED = int(os.environ.get("EAMPC_LAW_SEED", "1"))
# Relative to the range of the control; DAQP itself stops at 1e-9 of a row.
TOLERANCE = 1e-6


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


def online_control(problem: Problem, p: np.ndarray, u_min: float, u_max: float) -> float:
    """The control of an online QP solution at one parameter."""
    rows = problem.w + problem.S @ p
    solution, _, exit_flag, _ = daqp.solve(
        problem.H,
        problem.F @ p + problem.f,
        problem.G,
        rows,
        np.full_like(rows, -1e30),
        np.zeros(len(rows), dtype=np.int32),
        primal_tol=1e-9,
    )
    assert exit_flag == 1, f"the QP has no solution at p = {p.tolist()}"
    u = problem.output_U @ solution + problem.output_p @ p + problem.output_offset
    return float(np.clip(u, u_min, u_max))


@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("name", "variant"), READY)
def test_law_is_the_solution_of_its_problem(name: str, variant: str | None) -> None:
    law = law_of(name, variant)
    u_min, u_max = law.control_range
    p = sampled_parameters(law, SAMPLES, SEED)
    u, piece = law.evaluate(p, regions=True)
    assert piece.min() >= 0, "a parameter of the box has no piece"
    problem = law.problem
    expected = np.array([online_control(problem, row, u_min, u_max) for row in p])
    error = np.abs(u - expected) / (u_max - u_min)
    worst = int(error.argmax())
    assert error[worst] < TOLERANCE, (
        f"law {u[worst]}, QP {expected[worst]} at p = {p[worst].tolist()} (seed {SEED}); "
        f"{int((error >= TOLERANCE).sum())} of {SAMPLES} differ"
    )


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
        try:
            expected = online_control(hard, p, u_min, u_max)
        except AssertionError:
            continue
        assert abs(law.evaluate(p) - expected) < 1e-5 * (u_max - u_min), p.tolist()
        compared += 1
    assert compared > 100


def test_clamps_onto_the_box_as_the_daemon_does() -> None:
    law = law_of("reference")
    outside = 3.0 * law.upper
    assert law.evaluate(outside) == law.evaluate(law.upper)
    with pytest.raises(ValueError, match="angle_error, velocity_error"):
        law.evaluate([1.0, 2.0])
