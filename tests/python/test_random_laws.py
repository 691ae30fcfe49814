"""Laws of 200 seeded degenerate mpQPs: the evaluator against the regions, which test_random_mpqps
holds against an online solver, at random and placed parameters; and each law's certificate.

EAMPC_MPQP_SEEDS sets how many problems.
"""

import os

import numpy as np
import pytest
from eampc import _core, mpqp
from eampc.law_arrays import active_set_words
from mpqp_oracles import placed_points
from mpqp_problems import random_problem

SEEDS = int(os.environ.get("EAMPC_MPQP_SEEDS", "200"))
BATCH = 20
SAMPLES = 1000
# Of the output's range.
TOLERANCE = 1e-9


def first_input(problem: mpqp.Problem, low: float, high: float) -> _core.OutputLaw:
    inputs, parameters = problem.F.shape
    return _core.OutputLaw(np.eye(inputs)[0], np.zeros(parameters), 0.0, low, high)


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("first", range(0, SEEDS, BATCH))
def test_every_random_law_is_proved_and_right(first: int) -> None:
    refused: dict[int, str] = {}
    for seed in range(first, min(first + BATCH, SEEDS)):
        problem = random_problem(seed)
        solution = mpqp.solve(*problem[:6], (problem.lower, problem.upper), threads=1)
        random = np.random.default_rng(3000 + seed)
        p = np.vstack(
            [
                random.uniform(problem.lower, problem.upper, size=(SAMPLES, len(problem.lower))),
                placed_points(solution, random, SAMPLES // 4),
            ]
        )
        values = solution(p)[:, 0]
        p, values = p[~np.isnan(values)], values[~np.isnan(values)]
        # A range that clips some of it, so that saturated regions matter.
        low, high = np.quantile(values, 0.1) - 1e-3, np.quantile(values, 0.9) + 1e-3
        output = first_input(problem, low, high)
        regions = _core.solve_mpqp(**problem._asdict(), threads=1)
        try:
            tables, _ = _core.build_law_tables(regions, output, threads=1)
        except RuntimeError as refusal:
            refused[seed] = str(refusal)
            continue
        figures, _ = _core.certify_law(
            **problem._asdict(),
            output=output,
            active_sets=active_set_words(regions.regions, len(problem.w)),
            tables=tables,
            infeasible_allowed=True,
        )
        if not figures["proved"]:
            refused[seed] = str(figures["failure"])
            continue
        u, _ = _core.evaluate_tables(tables, np.ascontiguousarray(p))
        error = np.abs(np.clip(u, low, high) - np.clip(values, low, high)) / (high - low)
        assert error.max() <= TOLERANCE, f"seed {seed}: {error.max()} at {p[error.argmax()]}"
    assert not refused
