"""Critical regions of a multiparametric QP, one by one, from the flat arrays that hold them all."""

from __future__ import annotations

import itertools
import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FACET_KINDS = ("inner", "box", "parameter row", "infeasible", "saturated")


@dataclass(frozen=True, eq=False)
class Region:
    """A critical region {p : facet_normals @ p ≤ facet_offsets} and its affine solution.

    `facet_kinds` says per facet what lies beyond: "inner" other regions, listed in `neighbours`;
    "box" a face of the parameter box; "parameter row" and "infeasible" parameters without a
    solution, because of one row without U or because the rows contradict each other.
    """

    active_set: tuple[int, ...]  # rows of the problem that hold with equality, ascending
    gain: Array  # (n, np): U(p) = gain @ p + offset
    offset: Array  # (n,)
    facet_normals: Array  # (k, np), unit rows
    facet_offsets: Array  # (k,)
    facet_kinds: tuple[str, ...]  # k
    neighbours: tuple[tuple[int, ...], ...]  # k: indices of the regions beyond each facet
    interior: Array  # (np,), centre of a largest ball in the box scaled to ±1
    radius: float  # of that ball, in the same scale

    def __call__(self, p: ArrayLike) -> Array:
        """U at p (np,) or at every row of p (N, np), inside the region or not."""
        return np.asarray(p, float) @ self.gain.T + self.offset


class Regions(Sequence[Region]):
    """The regions of a solution; made on demand from its flat arrays."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self._arrays = arrays

    def __len__(self) -> int:
        return len(self._arrays["radius"])

    @overload
    def __getitem__(self, index: int) -> Region: ...
    @overload
    def __getitem__(self, index: slice) -> list[Region]: ...
    def __getitem__(self, index: int | slice) -> Region | list[Region]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        r = operator.index(index)
        r = r + len(self) if r < 0 else r
        if not 0 <= r < len(self):
            raise IndexError(f"region {index} of {len(self)}")
        a = self._arrays
        facets = slice(a["facet_first"][r], a["facet_first"][r + 1])
        first = a["neighbour_first"][facets.start : facets.stop + 1]
        return Region(
            tuple(a["active_rows"][a["active_first"][r] : a["active_first"][r + 1]].tolist()),
            a["gain"][r],
            a["offset"][r],
            a["facet_normals"][facets],
            a["facet_offsets"][facets],
            tuple(FACET_KINDS[kind] for kind in a["facet_kinds"][facets]),
            tuple(
                tuple(a["neighbours"][start:end].tolist())
                for start, end in itertools.pairwise(first)
            ),
            a["interior"][r],
            float(a["radius"][r]),
        )

    def __iter__(self) -> Iterator[Region]:
        return (self[r] for r in range(len(self)))
