"""PPOPT, the open multiparametric solver in Python, in a process of its own under a time limit."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from eampc.benchmark.problems import Array
from eampc.errors import RunFailed
from eampc.mpqp import Problem

ALGORITHMS = ("geometric", "graph", "combinatorial")
# A point this far beyond a facet, in the facet's unit normal, counts as covered: PPOPT's own
# tolerance of point location.
COVERED = 1e-5
# A new process imports PPOPT for this long at most.
_START_S = 60.0


@dataclass(frozen=True)
class OfflinePeer:
    """PPOPT's best algorithm on one problem; processor seconds of its solve, rows reduced by it."""

    algorithm: str
    seconds: float
    regions: int
    uncovered: int  # of the feasible points given
    not_finished: tuple[str, ...]  # algorithms that the limit ended


def best_of(
    problem: Problem, points: Array, limit_s: float, algorithms: tuple[str, ...] = ALGORITHMS
) -> OfflinePeer | None:
    """The fastest of the algorithms within `limit_s` seconds each; None if none finished."""
    best: OfflinePeer | None = None
    stopped: list[str] = []
    for algorithm in algorithms:
        found = _limited(problem, points, algorithm, limit_s)
        if found is None:
            stopped.append(algorithm)
            continue
        seconds, regions, uncovered = found
        if best is None or seconds < best.seconds:
            best = OfflinePeer(algorithm, seconds, regions, uncovered, ())
            limit_s = min(limit_s, seconds)  # slower ones need not finish
    if best is None:
        return None
    return OfflinePeer(best.algorithm, best.seconds, best.regions, best.uncovered, tuple(stopped))


def _limited(
    problem: Problem, points: Array, algorithm: str, limit_s: float
) -> tuple[float, int, int] | None:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(
        target=_solve, args=(theirs, problem._asdict(), points, algorithm), daemon=True
    )
    process.start()
    theirs.close()
    try:
        if not ours.poll(_START_S) or not _begun(ours):
            raise RunFailed(
                "PPOPT's process does not start; see what python -c 'import ppopt' says"
            )
        return ours.recv() if ours.poll(limit_s) else None
    except EOFError:  # it gave up on the problem
        return None
    finally:
        process.kill()
        process.join()


def _begun(answers: Connection) -> bool:
    try:
        return answers.recv() == "ready"
    except EOFError:
        return False


def _solve(answer: Connection, arrays: dict[str, Array], points: Array, algorithm: str) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # it prints as it goes
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # numpy's threads share one core
    program = importlib.import_module("ppopt.mpqp_program")
    solver = importlib.import_module("ppopt.mp_solvers.solve_mpqp")
    of = Problem(**arrays)
    count = len(of.lower)
    answer.send("ready")
    begin = time.process_time()
    stated = program.MPQP_Program(
        A=of.G,
        b=of.w[:, None],
        c=of.f[:, None],
        H=of.F,
        Q=of.H,
        A_t=np.vstack([np.eye(count), -np.eye(count)]),
        b_t=np.concatenate([of.upper, -of.lower])[:, None],
        F=of.S,
    )
    solution = solver.solve_mpqp(stated, getattr(solver.mpqp_algorithm, algorithm))
    seconds = time.process_time() - begin
    covered = np.zeros(len(points), dtype=bool)
    for region in solution.critical_regions:
        normals = np.linalg.norm(region.E, axis=1)
        covered |= ((points @ region.E.T - region.f.ravel()) / normals <= COVERED).all(axis=1)
    answer.send((seconds, len(solution.critical_regions), int((~covered).sum())))
