"""The explicit law of a benchmark problem as the daemon would run it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from eampc import _core
from eampc.benchmark.problems import Array, BenchmarkProblem
from eampc.law import Law
from eampc.mpqp import Solution, solve


@dataclass(frozen=True)
class BuiltLaw:
    """Regions of one problem and the evaluator over them."""

    regions: Solution
    tables: Any  # _core.LawTables
    explore_s: float
    structure_s: float

    def value(self, problem: BenchmarkProblem, points: Array) -> Array:
        """The clipped output at the points, by the daemon's own code."""
        return clipped(problem, self.tables, points)

    def active_rows(self) -> set[int]:
        """Rows of the problem that are active in some region: no other can matter in the box."""
        return set(np.unique(self.regions.arrays["active_rows"]).tolist())


def build_law(problem: BenchmarkProblem, threads: int = 1) -> BuiltLaw:
    """Explore all regions, then build and prove the evaluator; processor time of both."""
    of = problem.problem
    started = time.process_time()
    regions = solve(of.H, of.F, of.f, of.G, of.w, of.S, (of.lower, of.upper), threads=threads)
    explored = time.process_time()
    output = _core.OutputLaw(
        problem.output_U, problem.output_p, problem.output_offset, problem.y_min, problem.y_max
    )
    found = _core.solve_mpqp(**of._asdict(), threads=threads)
    before = time.process_time()
    tables, _ = _core.build_law_tables(found, output, threads=threads)
    done = time.process_time()
    return BuiltLaw(regions, tables, explored - started, done - before)


def active_rows(law: Law) -> set[int]:
    """Rows of the law's problem that are active in some region."""
    return {row for rows in law.active_sets for row in rows}


def tables_of(law: Law) -> Any:
    """The `_core.LawTables` that a law file holds."""
    of = law.payload["law"]
    evaluator = {k: v for k, v in of["evaluator"].items() if k != "worst_operations"}
    return _core.LawTables(
        piece_gain=of["piece_gain"], piece_offset=of["piece_offset"], **evaluator
    )


def clipped(problem: BenchmarkProblem, tables: Any, points: Array) -> Array:
    """The tables' value within y_min..y_max."""
    u, _ = _core.evaluate_tables(tables, np.ascontiguousarray(points))
    return np.clip(u, problem.y_min, problem.y_max)
