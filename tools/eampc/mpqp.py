"""Explicit solution of a multiparametric quadratic program: `solve(H, F, f, G, w, S, box)`.

    min over U of ½UᵀHU + (F p + f)ᵀU   subject to   G U ≤ w + S p,   lower ≤ p ≤ upper

for every parameter p of the box at once. The solution is affine on each of finitely many critical
regions, polytopes of p on which the set of active rows is fixed (Bemporad, Morari, Dua,
Pistikopoulos, "The explicit linear quadratic regulator for constrained systems", Automatica 38,
2002). The regions are found by crossing facets; where rows are dependent or multipliers vanish,
the problem with its right side moved by an infinitesimal, row by row different amount decides, so
that regions do not overlap.
"""

from __future__ import annotations

import json
import operator
import os
import zipfile
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eampc.critical_regions import FACET_KINDS, Region, Regions
from eampc.errors import UserError

Array = NDArray[np.float64]
Progress = Callable[[int, int], Any]

PROBLEM_KEYS = ("H", "F", "f", "G", "w", "S", "lower", "upper")
# A parameter this far outside a facet, in units of the box's half-width, still lies in the region.
INSIDE = 1e-9
MAX_PARAMETERS = 8
_FORMAT = "eampc mpqp solution 1"

__all__ = [
    "FACET_KINDS",
    "MpqpError",
    "NotProvedError",
    "Problem",
    "Region",
    "Regions",
    "Solution",
    "TimeLimitError",
    "checked_problem",
    "load",
    "load_problem",
    "solve",
]


class MpqpError(UserError, ValueError):
    """A problem, parameter or file that cannot be used: what is wrong and how to mend it."""


class NotProvedError(UserError, RuntimeError):
    """No solution whose regions are proved to cover the parameters, and why."""

    exit_code = 1


class TimeLimitError(NotProvedError):
    """`time_limit_s` was over before the regions were complete."""


class Problem(NamedTuple):
    """min over U of ½UᵀHU + (F p + f)ᵀU subject to G U ≤ w + S p, for lower ≤ p ≤ upper."""

    H: Array  # (n, n), positive definite
    F: Array  # (n, np)
    f: Array  # (n,)
    G: Array  # (m, n)
    w: Array  # (m,)
    S: Array  # (m, np)
    lower: Array  # (np,)
    upper: Array  # (np,)


class Solution:
    """What `solve` returns: `problem`, `regions`, `statistics`, and U(p) by calling it.

    `arrays` holds the same regions flat, as numpy arrays. Facets of region r are
    facet_first[r]:facet_first[r+1] of facet_normals (., np), facet_offsets and facet_kinds (index
    into FACET_KINDS). Neighbours of facet f are neighbour_first[f]:neighbour_first[f+1] of
    neighbours. Active rows of region r are active_first[r]:active_first[r+1] of active_rows. And
    per region gain (R, n, np), offset (R, n), interior (R, np), radius (R,).
    """

    def __init__(
        self, problem: Problem, arrays: dict[str, NDArray[Any]], statistics: dict[str, Any]
    ) -> None:
        self.problem = problem
        self.arrays = arrays
        self.statistics = statistics

    @cached_property
    def regions(self) -> Regions:
        return Regions(self.arrays)

    @property
    def has_infeasible_parameters(self) -> bool:
        """Some parameters of the box have no solution."""
        return bool(self.statistics["has_infeasible_parameters"])

    def region_index(self, p: ArrayLike) -> NDArray[np.int32]:
        """Index of a region that holds each row of p (N, np) or p (np,); -1 without a solution.

        Raises MpqpError for a wrong shape, a number not finite, a parameter outside the box.
        """
        rows = self._parameters(p)
        found = self._located(rows)
        return found.reshape(np.shape(np.asarray(p))[:-1])

    def __call__(self, p: ArrayLike, *, strict: bool = False) -> Array:
        """U(p): (n,) for p (np,), (N, n) for the rows of p (N, np).

        NaN where the problem has no solution; `strict` raises MpqpError there instead. Raises
        MpqpError for a wrong shape, a number that is not finite, a parameter outside the box.
        """
        rows = self._parameters(p)
        region = self._located(rows)
        if strict and (region < 0).any():
            bad = int(np.argmax(region < 0))
            raise MpqpError(
                f"the problem has no solution at p = {rows[bad].tolist()} (row {bad}): its "
                "constraints contradict each other there"
            )
        a = self.arrays
        U = np.full((len(rows), a["offset"].shape[1]), np.nan)
        known = region >= 0
        held = region[known]
        U[known] = np.einsum("rij,rj->ri", a["gain"][held], rows[known]) + a["offset"][held]
        return U.reshape(*np.shape(np.asarray(p))[:-1], -1)

    def _parameters(self, p: ArrayLike) -> Array:
        lower, upper = self.problem.lower, self.problem.upper
        rows = _numbers("p", p)
        if rows.ndim not in (1, 2) or rows.shape[-1] != len(lower):
            raise MpqpError(f"p must have {len(lower)} entries per row, not shape {rows.shape}")
        rows = np.ascontiguousarray(rows.reshape(-1, len(lower)))
        reach = 0.5 * (upper - lower) * (1.0 + INSIDE)
        outside = (np.abs(rows - 0.5 * (lower + upper)) > reach).any(axis=1)
        if outside.any():
            bad = int(np.argmax(outside))
            raise MpqpError(
                f"p = {rows[bad].tolist()} (row {bad}) lies outside the box {lower.tolist()} to "
                f"{upper.tolist()} that was solved; solve a larger box or clamp p to this one"
            )
        return rows

    def _located(self, rows: Array) -> NDArray[np.int32]:
        from eampc import _core

        return _core.locate_regions(
            **{key: self._scaled[key] for key in ("facet_normals", "facet_offsets")},
            **{
                key: self.arrays[key]
                for key in ("facet_first", "facet_kinds", "neighbour_first", "neighbours")
            },
            p=np.ascontiguousarray((rows - self._scaled["centre"]) / self._scaled["half_width"]),
            tolerance=INSIDE,
        )

    @cached_property
    def _scaled(self) -> dict[str, Array]:
        """Facets in the box scaled to ±1, where one tolerance suits every parameter."""
        centre = 0.5 * (self.problem.lower + self.problem.upper)
        half_width = 0.5 * (self.problem.upper - self.problem.lower)
        normals = self.arrays["facet_normals"]
        scaled = normals * half_width
        norms = np.linalg.norm(scaled, axis=1)
        return {
            "centre": centre,
            "half_width": half_width,
            "facet_normals": np.ascontiguousarray(scaled / norms[:, None]),
            "facet_offsets": (self.arrays["facet_offsets"] - normals @ centre) / norms,
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write problem, regions and statistics to an .npz file that `load` reads."""
        with Path(path).open("wb") as file:
            np.savez_compressed(
                file,
                format=_FORMAT,
                statistics=json.dumps(self.statistics),
                **{f"problem_{key}": value for key, value in self.problem._asdict().items()},
                **self.arrays,
            )

    def __repr__(self) -> str:
        n, np_ = self.problem.F.shape
        return f"<eampc.mpqp.Solution: {len(self.regions)} regions, n = {n}, np = {np_}>"


def solve(
    H: ArrayLike,
    F: ArrayLike,
    f: ArrayLike,
    G: ArrayLike,
    w: ArrayLike,
    S: ArrayLike,
    box: tuple[ArrayLike, ArrayLike],
    *,
    threads: int = 0,
    progress: Progress | None = None,
    time_limit_s: float | None = None,
    max_regions: int = 1_000_000,
    random_points: int = 2000,
    seed: int = 1,
) -> Solution:
    """Solve min over U of ½UᵀHU + (F p + f)ᵀU subject to G U ≤ w + S p for every p of the box.

    H (n, n) positive definite, F (n, np), f (n,), G (m, n), w (m,), S (m, np), box = (lower, upper)
    of (np,) each, 1 ≤ np ≤ 8; anything that numpy makes an array of floats of. Rows of G may be
    zero (they bound p only), repeated, redundant or dependent, and parts of the box may have no
    solution.

    threads: how many to use, 0 for one per core; the solution is the same to the bit for any.
    progress(explored, found): called from this thread about ten times a second; if it returns False
    the call ends with eampc.mpqp.Cancelled, and an exception in it is raised again.
    time_limit_s: TimeLimitError after this many seconds. max_regions: NotProvedError beyond.
    random_points: seeded points checked in addition to the facets.

    Raises MpqpError (a ValueError) for arrays that do not make a problem, or one that has no
    solution anywhere in the box; NotProvedError (a RuntimeError) if rounding leaves it open whether
    the regions cover every feasible parameter: no solution is returned then.
    """
    from eampc import _core

    problem = checked_problem(H, F, f, G, w, S, box)
    limit_s = np.inf if time_limit_s is None else _positive("time_limit_s", time_limit_s)
    try:
        solution = _core.solve_mpqp(
            **problem._asdict(),
            threads=_count("threads", threads, 0),
            progress=progress,
            time_limit_s=limit_s,
            max_regions=_count("max_regions", max_regions, 1),
            random_points=_count("random_points", random_points, 0),
            seed=_count("seed", seed, 0),
        )
    except _core.TimeLimit as error:
        raise TimeLimitError(str(error)) from None
    except ValueError as error:
        raise MpqpError(str(error)) from None
    except RuntimeError as error:
        if isinstance(error, _core.Cancelled):
            raise
        raise NotProvedError(str(error)) from None
    statistics = dict(solution.statistics)
    statistics["has_infeasible_parameters"] = solution.has_infeasible_parameters
    return Solution(problem, solution.arrays(), statistics)


def checked_problem(
    H: ArrayLike,
    F: ArrayLike,
    f: ArrayLike,
    G: ArrayLike,
    w: ArrayLike,
    S: ArrayLike,
    box: tuple[ArrayLike, ArrayLike],
) -> Problem:
    """The problem as contiguous arrays of floats; MpqpError names an argument that does not fit."""
    try:
        lower, upper = box
    except (TypeError, ValueError):
        raise MpqpError("box must be a pair (lower, upper) of parameter vectors") from None
    given = dict(zip(PROBLEM_KEYS, (H, F, f, G, w, S, lower, upper), strict=True))
    a = {name: _numbers(name, value) for name, value in given.items()}
    for name in ("lower", "upper", "f", "w"):
        if a[name].ndim != 1:
            raise MpqpError(f"{name} must be a vector, not of shape {a[name].shape}")
    n, count, m = len(a["f"]), len(a["lower"]), len(a["w"])
    if n == 0:
        raise MpqpError("f must have at least one entry: there is nothing to optimise")
    if not 1 <= count <= MAX_PARAMETERS:
        raise MpqpError(f"box must have 1 to {MAX_PARAMETERS} parameters, not {count}")
    shapes = {"H": (n, n), "F": (n, count), "G": (m, n), "S": (m, count), "upper": (count,)}
    for name, shape in shapes.items():
        if a[name].shape != shape:
            raise MpqpError(
                f"{name} must have shape {shape} to fit f ({n},), w ({m},) and lower ({count},), "
                f"not {a[name].shape}"
            )
    for j in range(count):
        if not a["lower"][j] < a["upper"][j]:
            raise MpqpError(
                f"lower must be below upper for every parameter, but parameter {j} has "
                f"{a['lower'][j]:g} and {a['upper'][j]:g}; leave out a parameter that is fixed"
            )
    scale = np.abs(a["H"]).max()
    if np.abs(a["H"] - a["H"].T).max() > 1e-9 * scale:
        raise MpqpError("H must be symmetric; pass (H + H.T)/2")
    return Problem(**a)


def load(path: str | os.PathLike[str]) -> Solution:
    """Read a solution that `Solution.save` wrote; MpqpError for any other file."""
    stored = _archive(path)
    if str(stored.get("format", "")) != _FORMAT:
        raise MpqpError(f"{path}: this is no solution written by eampc.mpqp; solve it again")
    try:
        problem = checked_problem(
            *(stored[f"problem_{key}"] for key in PROBLEM_KEYS[:6]),
            (stored["problem_lower"], stored["problem_upper"]),
        )
        arrays = {key: np.ascontiguousarray(stored[key], kind) for key, kind in _ARRAYS.items()}
        statistics = json.loads(str(stored["statistics"]))
        solution = Solution(problem, arrays, statistics)
        _require_consistent(solution)
    except (KeyError, TypeError, ValueError, MpqpError) as error:
        raise MpqpError(f"{path}: the solution is damaged ({error}); solve it again") from None
    return solution


def load_problem(path: str | os.PathLike[str]) -> Problem:
    """Read a problem from an .npz file with the arrays H, F, f, G, w, S, lower, upper."""
    stored = _archive(path)
    missing = [key for key in PROBLEM_KEYS if key not in stored]
    if missing:
        raise MpqpError(
            f"{path}: {', '.join(missing)} missing; the file must hold {', '.join(PROBLEM_KEYS)}"
        )
    try:
        return checked_problem(
            *(stored[key] for key in PROBLEM_KEYS[:6]), (stored["lower"], stored["upper"])
        )
    except MpqpError as error:
        raise MpqpError(f"{path}: {error}") from None


_ARRAYS: dict[str, Any] = {
    "active_first": np.int64,
    "active_rows": np.int32,
    "gain": np.float64,
    "offset": np.float64,
    "facet_first": np.int64,
    "facet_normals": np.float64,
    "facet_offsets": np.float64,
    "facet_kinds": np.int8,
    "neighbour_first": np.int64,
    "neighbours": np.int32,
    "interior": np.float64,
    "radius": np.float64,
}


def _require_consistent(solution: Solution) -> None:
    a, (n, count) = solution.arrays, solution.problem.F.shape
    regions = len(a["radius"])
    shapes = {
        "active_first": (regions + 1,),
        "gain": (regions, n, count),
        "offset": (regions, n),
        "facet_first": (regions + 1,),
        "facet_normals": (len(a["facet_offsets"]), count),
        "interior": (regions, count),
    }
    for name, shape in shapes.items():
        if a[name].shape != shape:
            raise ValueError(f"{name} has shape {a[name].shape} instead of {shape}")
    for name, array in a.items():
        if not np.isfinite(array).all():
            raise ValueError(f"{name} holds a number that is not finite")
    first, rows = a["active_first"], a["active_rows"]
    if first[0] != 0 or first[-1] != len(rows) or (np.diff(first) < 0).any():
        raise ValueError("active_first does not divide active_rows")
    if len(rows) and not (rows.min() >= 0 and rows.max() < len(solution.problem.w)):
        raise ValueError("active_rows names a row that the problem does not have")
    if not np.isin(a["facet_kinds"], range(len(FACET_KINDS))).all():
        raise ValueError("facet_kinds holds an unknown kind")
    solution._located(np.empty((0, count)))  # refuses facets and neighbours that do not fit


def _archive(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except FileNotFoundError:
        raise MpqpError(f"{path}: there is no such file") from None
    except (OSError, ValueError, AttributeError, zipfile.BadZipFile, EOFError) as error:
        raise MpqpError(f"{path}: not an .npz archive of plain arrays ({error})") from None


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise MpqpError(f"{name} must be an array of real numbers") from None
    if np.ndim(value) == 0:
        raise MpqpError(f"{name} must be an array, not a single number")
    if not np.isfinite(array).all():
        raise MpqpError(f"{name} must hold finite numbers only")
    return array


def _positive(name: str, value: float) -> float:
    number = float(value)
    if not number > 0.0:
        raise MpqpError(f"{name} must be above zero, not {value}")
    return number


def _count(name: str, value: int, least: int) -> int:
    number = operator.index(value)
    if not least <= number <= 2**31 - 1:
        raise MpqpError(f"{name} must be at least {least}, not {value}")
    return number


def __getattr__(name: str) -> Any:
    if name == "Cancelled":
        from eampc import _core

        return _core.Cancelled
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
