"""`eampc bench law`: one evaluation of the explicit law beside one solve of each peer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eampc import _core
from eampc.benchmark import online_peers
from eampc.benchmark.law_structure import clipped
from eampc.benchmark.online_peers import PeerTiming
from eampc.benchmark.problems import Array, BenchmarkProblem, BoundedForm, as_given
from eampc.errors import RunFailed

POINTS = 4096
FRESH_POINTS = 100_000
# The interior-point and splitting solvers are called from Python: fewer points say as much.
SLOW_PEER_POINTS = 256
# Many end early: the horizon is short, and not every reference can be held.
LOOPS, STEPS_PER_LOOP = 1024, 64
# Peers stop at their own tolerances; beyond this share of the output's range it is another problem.
AGREEMENT = 0.01
PEERS = ("daqp", "osqp", "piqp", "clarabel")

Report = Callable[[str], None]


@dataclass(frozen=True)
class OnlineFigures:
    """Of one problem. Nanoseconds per evaluation; points alone include the timer."""

    problem: str
    pieces: int
    kind: str
    worst_operations: int
    table_bytes: int
    timer_ns: float
    sweep_ns: float
    worst_ns: float
    fresh_ns: float
    chain_ns: float
    cold_median_ns: float
    cold_worst_ns: float
    loop_ns: float  # sweep of the closed-loop points; NaN without them
    peers: tuple[PeerFigures, ...]


@dataclass(frozen=True)
class PeerFigures:
    """Over its points; `ratio` = its mean over ours, a sweep of the same points."""

    name: str
    counted: str
    points: int
    mean_ns: float
    median_ns: float
    worst_ns: float
    ratio: float
    failed: int
    largest_difference: float  # of the output, as a share of its range


def random_points(problem: BenchmarkProblem, form: BoundedForm, count: int, seed: int) -> Array:
    """(count, np): uniform in the box, those that have a solution (judged by DAQP)."""
    random = np.random.default_rng(seed)
    lower, upper = problem.problem.lower, problem.problem.upper
    found: list[Array] = []
    missing = count
    for _ in range(200):
        points = random.uniform(lower, upper, (2 * count, len(lower)))
        good = points[online_peers.feasible(problem, form, points)][:missing]
        found.append(good)
        missing -= len(good)
        if missing == 0:
            return np.ascontiguousarray(np.vstack(found))
    raise RunFailed(f"{problem.name}: too few parameters of the box have a solution")


def between(points: Array, count: int, seed: int) -> Array:
    """Fresh feasible points: the parameters with a solution are convex."""
    random = np.random.default_rng(seed)
    first, second = random.integers(len(points), size=(2, count))
    share = random.random((count, 1))
    return np.ascontiguousarray(points[first] + share * (points[second] - points[first]))


def loop_points(
    problem: BenchmarkProblem, tables: Any, form: BoundedForm, starts: Array
) -> Array | None:
    """Parameters of nominal closed loops, one loop after another, as far as each is feasible."""
    if problem.recorded is not None:
        return np.ascontiguousarray(problem.recorded)
    if problem.successor is None:
        return None
    p = starts[:LOOPS]
    steps = [p]
    for _ in range(STEPS_PER_LOOP - 1):
        p = problem.successor(p, clipped(problem, tables, p))
        steps.append(p)
    loops = np.stack(steps, axis=1)
    count = loops.shape[-1]
    flat = np.ascontiguousarray(loops.reshape(-1, count))
    inside = ((flat >= problem.problem.lower) & (flat <= problem.problem.upper)).all(axis=1)
    good = (inside & online_peers.feasible(problem, form, flat)).reshape(loops.shape[:2])
    return np.ascontiguousarray(loops[np.logical_and.accumulate(good, axis=1)][:POINTS])


def measure(
    problem: BenchmarkProblem,
    tables: Any,
    form: BoundedForm,
    *,
    peers: tuple[str, ...] = PEERS,
    points: int = POINTS,
    seed: int = 1,
    report: Report = lambda _step: None,
) -> OnlineFigures:
    """Time the law and its peers on the same points; RunFailed if a peer finds another output."""
    report("points")
    known = random_points(problem, form, points, seed)
    fresh = between(known, FRESH_POINTS, seed + 1)
    loop = loop_points(problem, tables, form, known)
    report("law")
    ours = _core.time_law(tables, known, fresh, problem.y_min, problem.y_max)
    loop_ns = np.nan
    if loop is not None:
        loop_ns = _core.time_law(
            tables, loop, loop[:1], problem.y_min, problem.y_max, cold_points=0
        )["sweep_ns"]
    figures = []
    for name in peers:
        report(name)
        if name == "daqp":
            given = as_given(problem.problem)
            for rows, how in ((given, "all rows"), (form, "reduced rows")):
                how = f"cold, prepared, {how}"
                cold = online_peers.daqp(problem, rows, known, warm=False, how=how)
                figures.append(_compared(problem, tables, known, cold, ours["sweep_ns"]))
            if loop is not None:
                how = "warm, closed loop, reduced rows"
                warm = online_peers.daqp(problem, form, loop, warm=True, how=how)
                figures.append(_compared(problem, tables, loop, warm, loop_ns))
        else:
            few = known[:SLOW_PEER_POINTS]
            timing = getattr(online_peers, name)(problem, form, few)
            figures.append(_compared(problem, tables, few, timing, ours["sweep_ns"]))
    return OnlineFigures(
        problem=problem.name,
        pieces=len(tables.piece_offset),
        kind=tables.kind,
        worst_operations=int(tables.worst_operations),
        table_bytes=int(ours["bytes"]),
        timer_ns=ours["timer_ns"],
        sweep_ns=ours["sweep_ns"],
        worst_ns=float(ours["point_ns"].max()),
        fresh_ns=ours["fresh_ns"],
        chain_ns=ours["chain_ns"],
        cold_median_ns=float(np.median(ours["cold_ns"])),
        cold_worst_ns=float(ours["cold_ns"].max()),
        loop_ns=float(loop_ns),
        peers=tuple(figures),
    )


def _compared(
    problem: BenchmarkProblem, tables: Any, points: Array, timing: PeerTiming, ours_ns: float
) -> PeerFigures:
    solved = np.isfinite(timing.y)
    difference = np.abs(timing.y - clipped(problem, tables, points))[solved]
    largest = float(difference.max(initial=0.0)) / (problem.y_max - problem.y_min)
    if largest > AGREEMENT:
        raise RunFailed(
            f"{problem.name}: {timing.name} and the law differ by {largest:.2%} of the output's "
            "range; one of them is wrong, so their times are not compared"
        )
    times = timing.point_ns[solved]
    mean = float(times.mean()) if times.size else np.nan
    return PeerFigures(
        name=timing.name,
        counted=timing.counted,
        points=len(points),
        mean_ns=mean,
        median_ns=float(np.median(times)) if times.size else np.nan,
        worst_ns=float(times.max()) if times.size else np.nan,
        ratio=mean / ours_ns,
        failed=int((~solved).sum()),
        largest_difference=largest,
    )
