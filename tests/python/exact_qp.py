"""Solution of one strictly convex QP in rational arithmetic: the judge where doubles differ.

A law may be steep (gains of 1e5 over the parameter box), and an online solver stops at rows
violated by 1e-10: on a facet both can be right to their tolerance and differ by 1e-6.
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np

Rational = list[Fraction]


def exact_solution(
    problem: Any, p: np.ndarray, guesses: Iterable[Sequence[int]], near: Sequence[int]
) -> Rational | None:
    """U(p), exactly, of the data as they are: the active rows are one of the guesses or, if none of
    these satisfies the optimality conditions, some of the rows `near` being active.
    """
    data = _at(problem, p)
    n = len(data[0])
    every = (rows for size in range(min(n, len(near)) + 1) for rows in combinations(near, size))
    for source in (guesses, every):
        for rows in source:
            U = _optimum(data, rows)
            if U is not None:
                return U
    return None


def _rational(a: np.ndarray) -> list[Rational]:
    return [[Fraction(float(x)) for x in row] for row in np.atleast_2d(a)]


def _at(problem: Any, p: np.ndarray) -> tuple[list[Rational], Rational, list[Rational], Rational]:
    """H, F p + f, G, w + S p."""
    q = [Fraction(float(x)) for x in p]

    def affine(constant: np.ndarray, slope: np.ndarray) -> Rational:
        return [
            Fraction(float(c)) + sum(a * b for a, b in zip(row, q, strict=True))
            for c, row in zip(constant, _rational(slope), strict=True)
        ]

    return (
        _rational(problem.H),
        affine(problem.f, problem.F),
        _rational(problem.G),
        affine(problem.w, problem.S),
    )


def _optimum(data: tuple[Any, ...], rows: Sequence[int]) -> Rational | None:
    """U with these rows active if it satisfies the Karush-Kuhn-Tucker conditions."""
    H, f, G, w = data
    n, zeros = len(H), [Fraction(0)] * len(rows)
    system = [H[i] + [G[r][i] for r in rows] + [-f[i]] for i in range(n)]
    system += [G[r] + zeros + [w[r]] for r in rows]
    x = _solve(system)
    if x is None or any(multiplier < 0 for multiplier in x[n:]):
        return None
    if any(sum(a * b for a, b in zip(G[i], x, strict=False)) > w[i] for i in range(len(w))):
        return None
    return x[:n]


def _solve(system: list[Rational]) -> Rational | None:
    """Gauss and Jordan; None if singular. Rows are (A, b)."""
    rows = [row[:] for row in system]
    for c in range(len(rows)):
        pivot = next((r for r in range(c, len(rows)) if rows[r][c] != 0), None)
        if pivot is None:
            return None
        rows[c], rows[pivot] = rows[pivot], rows[c]
        scale = 1 / rows[c][c]
        rows[c] = [scale * x for x in rows[c]]
        for r in range(len(rows)):
            factor = rows[r][c]
            if r != c and factor != 0:
                rows[r] = [a - factor * b for a, b in zip(rows[r], rows[c], strict=True)]
    return [row[-1] for row in rows]
