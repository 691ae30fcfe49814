"""An explicit law: what its file holds, and its value by the daemon's own code."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eampc.law_arrays import active_set_rows, law_tables
from eampc.law_file import encode_law, read_law, write_law

Array = NDArray[np.float64]


class Problem(NamedTuple):
    """min over U of UᵀHU/2 + (F p + f)ᵀU subject to G U ≤ w + S p, for lower ≤ p ≤ upper.

    The control is output_U·U + output_p·p + output_offset, clipped to `Law.control_range`. U are
    the n free moves in units of the control u (formulation tracking: their deviations from u_ss),
    and with soft state bounds the slack, a ratio; p are the n_p parameters of
    `Law.parameter_names` in `Law.parameter_units`; there are m rows.
    """

    H: Array  # (n, n)
    F: Array  # (n, n_p)
    f: Array  # (n,)
    G: Array  # (m, n)
    w: Array  # (m,)
    S: Array  # (m, n_p)
    lower: Array  # (n_p,)
    upper: Array  # (n_p,)
    output_U: Array  # (n,)
    output_p: Array  # (n_p,)
    output_offset: float


class Law:
    """A law as `design` made it or `load_law` read it.

    `payload` is the content of the law file (see `eampc.law_file`), arrays as numpy arrays.
    """

    def __init__(self, payload: Mapping[str, Any], design_seconds: float | None = None) -> None:
        self.payload = payload
        self.design_seconds = design_seconds
        """Wall-clock time of the design; None for a law read from a file."""

    @cached_property
    def checked(self) -> Any:
        """The law as the daemon holds it: `_core.Law`, loaded from this law's bytes."""
        from eampc import _core

        return _core.law_from_bytes(self.to_bytes(), repr(self))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the n_p entries of p, in order."""
        return tuple(self.payload["law"]["parameter_names"])

    @property
    def parameter_units(self) -> tuple[str, ...]:
        """Units of the entries of p, as "rad/s"; "u" is the unit of the control."""
        return tuple(self.payload["law"]["parameter_units"])

    @property
    def lower(self) -> Array:
        """Lower corner of the parameter box, (n_p,)."""
        return self.payload["law"]["lower"]

    @property
    def upper(self) -> Array:
        """Upper corner of the parameter box, (n_p,)."""
        return self.payload["law"]["upper"]

    @property
    def control_range(self) -> tuple[float, float]:
        """u_min, u_max: the range that the control is clipped to, in units of u."""
        return self.payload["law"]["u_min"], self.payload["law"]["u_max"]

    @property
    def statistics(self) -> dict[str, Any]:
        """Counts: regions; pieces, hyperplanes, nodes, depth, leaves, terms; problem rows."""
        return dict(self.payload["law"]["statistics"])

    @property
    def problem(self) -> Problem:
        """The parametric quadratic program that the law solves."""
        return Problem(**{name: self.payload["problem"][name] for name in Problem._fields})

    @property
    def pieces(self) -> tuple[Array, Array]:
        """(gain, offset) of the k affine pieces, (k, n_p) and (k,): u = gain·p + offset."""
        law = self.payload["law"]
        return law["piece_gain"], law["piece_offset"]

    @cached_property
    def tables(self) -> Any:
        """Pieces and evaluator as `_core.LawTables`."""
        return law_tables(self.payload["law"])

    @property
    def active_sets(self) -> list[list[int]]:
        """Active rows of the problem in each critical region of the box."""
        return active_set_rows(self.payload["law"]["active_sets"])

    @overload
    def evaluate(self, p: ArrayLike, *, regions: Literal[False] = False) -> Array: ...
    @overload
    def evaluate(
        self, p: ArrayLike, *, regions: Literal[True]
    ) -> tuple[Array, NDArray[np.int32]]: ...
    def evaluate(
        self, p: ArrayLike, *, regions: bool = False
    ) -> Array | tuple[Array, NDArray[np.int32]]:
        """Control u by the daemon's own code: p of shape (n, n_p) → (n,), or (n_p,) → a number.

        p is in `parameter_units` and clamped onto the box; u, in units of the control, is clipped
        to `control_range`. NaN in p gives NaN. With `regions` also the index of the affine piece
        that applied, of the same shape. Raises ValueError for any other shape.
        """
        points = np.asarray(p, dtype=np.float64)
        names = self.parameter_names
        if points.ndim not in (1, 2) or points.shape[-1] != len(names):
            raise ValueError(
                f"p has the shape {points.shape}, but must be (n, {len(names)}) or "
                f"({len(names)},): {', '.join(names)}"
            )
        u, piece, _clamped = self.checked.evaluate(np.atleast_2d(points))
        if points.ndim == 1:
            u, piece = u[0], piece[0]
        return (u, piece) if regions else u

    def to_bytes(self) -> bytes:
        """Return the law file's bytes; the same design gives the same bytes."""
        return encode_law(self.payload)

    def save(self, path: str | Path) -> int:
        """Write the law file; return its size in bytes."""
        return write_law(path, self.payload)

    def __repr__(self) -> str:
        rig = self.payload["rig"]
        variant = f" ({rig['variant']})" if rig["variant"] else ""
        s = self.statistics
        return f"<Law {rig['name']}{variant}: {s.get('regions')} regions, {s.get('pieces')} pieces>"


def load_law(path: str | Path) -> Law:
    """Read a law file; raises LawFileError, one sentence, if it cannot be used."""
    return Law(read_law(path))
