"""`eampc bench offline`: exploration and structure of the explicit law beside PPOPT's solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from eampc.benchmark.law_structure import build_law
from eampc.benchmark.offline_peer import ALGORITHMS, OfflinePeer, best_of
from eampc.benchmark.online import random_points
from eampc.benchmark.problems import BenchmarkProblem, as_given

COVERAGE_POINTS = 20_000


@dataclass(frozen=True)
class OfflineFigures:
    """Of one problem. Processor seconds; uncovered: random feasible points in no region."""

    problem: str
    explore_s: float
    structure_s: float
    regions: int
    rows_given: int
    rows_kept: int
    pieces: int
    table_kind: str
    points: int
    uncovered: int
    peer: OfflinePeer | None  # None: nothing finished within the limit, or not asked for
    peer_limit_s: float

    @property
    def ratio(self) -> float | None:
        """PPOPT's best time over ours for the same task, the critical regions."""
        return None if self.peer is None else self.peer.seconds / self.explore_s


def measure(
    problem: BenchmarkProblem,
    *,
    peer: bool = True,
    limit_s: float = 60.0,
    points: int = COVERAGE_POINTS,
    algorithms: tuple[str, ...] = ALGORITHMS,
    seed: int = 1,
    report: Callable[[str], None] = lambda _step: None,
) -> OfflineFigures:
    """Solve the problem by both; each of PPOPT's algorithms within `limit_s`."""
    report("law")
    built = build_law(problem, threads=1)
    statistics = built.regions.statistics
    report("coverage")
    feasible = random_points(problem, as_given(problem.problem), points, seed)
    uncovered = int((built.regions.region_index(feasible) < 0).sum())
    report("PPOPT")
    best = best_of(problem.problem, feasible, limit_s, algorithms) if peer else None
    return OfflineFigures(
        problem=problem.name,
        explore_s=built.explore_s,
        structure_s=built.structure_s,
        regions=len(built.regions.regions),
        rows_given=int(statistics["rows_given"]),
        rows_kept=int(statistics["rows_kept"]),
        pieces=len(built.tables.piece_offset),
        table_kind=built.tables.kind,
        points=points,
        uncovered=uncovered,
        peer=best,
        peer_limit_s=limit_s,
    )
