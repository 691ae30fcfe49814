"""Pieces, evaluator and active sets of a law: between the arrays of its file and what uses them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from eampc import _core


def tables_payload(tables: _core.LawTables) -> dict[str, Any]:
    """The entries piece_gain, piece_offset and evaluator of the section law."""
    arrays = (
        "hyperplanes",
        "node_planes",
        "node_children",
        "leaf_care",
        "leaf_bits",
        "leaf_first",
        "term_first",
        "term_pieces",
        "fold",
    )
    return {
        "piece_gain": tables.piece_gain,
        "piece_offset": tables.piece_offset,
        "evaluator": {
            "kind": tables.kind,
            "worst_operations": tables.worst_operations,
            "root": tables.root,
            "depth": tables.depth,
            **{name: getattr(tables, name) for name in arrays},
        },
    }


def active_set_words(regions: Any, rows: int) -> np.ndarray:
    """(n_regions, ceil(rows/32)) int32: bit j % 32 of word j // 32 is set if row j is active."""
    active = np.zeros((len(regions), -(-rows // 32) * 32), dtype=np.uint8)
    for bits, region in zip(active, regions, strict=True):
        bits[region.active_set] = 1
    return np.packbits(active, axis=1, bitorder="little").view("<i4")


def active_set_rows(words: np.ndarray) -> list[list[int]]:
    """The active rows of each region, from what `active_set_words` returned."""
    octets = np.ascontiguousarray(words, dtype="<i4").view(np.uint8)
    bits = np.unpackbits(octets, axis=1, bitorder="little")
    return [np.flatnonzero(row).tolist() for row in bits]


def law_tables(law: Mapping[str, Any]) -> Any:
    """`_core.LawTables` of the section law; ValueError names the key that is wrong."""
    from eampc import _core

    evaluator = {key: value for key, value in law["evaluator"].items() if key != "worst_operations"}
    return _core.LawTables(
        piece_gain=law["piece_gain"], piece_offset=law["piece_offset"], **evaluator
    )
