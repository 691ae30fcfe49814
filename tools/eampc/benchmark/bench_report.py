"""The benchmark's tables: for a terminal, as JSON, as Markdown."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rich.table import Table

from eampc.benchmark.machine import machine_sentence
from eampc.benchmark.offline import OfflineFigures
from eampc.benchmark.online import OnlineFigures

LAW_COLUMNS = (
    ("problem", lambda f: f.problem),
    ("pieces", lambda f: str(f.pieces)),
    ("kind", lambda f: f.kind),
    ("operations, worst", lambda f: str(f.worst_operations)),
    ("tables, kB", lambda f: f"{f.table_bytes / 1e3:.1f}"),
    ("sweep, ns", lambda f: _ns(f.sweep_ns)),
    ("worst point, ns", lambda f: _ns(f.worst_ns)),
    ("fresh, ns", lambda f: _ns(f.fresh_ns)),
    ("chain, ns", lambda f: _ns(f.chain_ns)),
    ("cold median, ns", lambda f: _ns(f.cold_median_ns)),
    ("cold worst, ns", lambda f: _ns(f.cold_worst_ns)),
)
PEER_COLUMNS = ("problem", "peer", "points", "mean, ns", "median, ns", "worst, ns", "peer/law")
OFFLINE_COLUMNS = (
    "problem",
    "rows",
    "regions",
    "explore, s",
    "structure, s",
    "uncovered",
    "PPOPT",
    "regions",
    "seconds",
    "uncovered",
    "PPOPT/explore",
)


def law_rows(figures: list[OnlineFigures]) -> list[list[str]]:
    return [[text(f) for _, text in LAW_COLUMNS] for f in figures]


def peer_rows(figures: list[OnlineFigures]) -> list[list[str]]:
    rows = []
    for f in figures:
        for peer in f.peers:
            solved = f"{peer.points}" + (f" ({peer.failed} failed)" if peer.failed else "")
            times = (_ns(peer.mean_ns), _ns(peer.median_ns), _ns(peer.worst_ns))
            rows.append([f.problem, peer.name, solved, *times, f"{peer.ratio:.0f}x"])
    return rows


def offline_rows(figures: list[OfflineFigures]) -> list[list[str]]:
    rows = []
    for f in figures:
        ours = [
            f.problem,
            f"{f.rows_kept} of {f.rows_given}",
            str(f.regions),
            f"{f.explore_s:.4f}",
            f"{f.structure_s:.4f}",
            f"{f.uncovered} of {f.points}",
        ]
        if f.peer is None:
            rows.append([*ours, f"none within {f.peer_limit_s:g} s", "", "", "", ""])
            continue
        peer = f.peer
        rows.append(
            [
                *ours,
                peer.algorithm,
                str(peer.regions),
                f"{peer.seconds:.2f}",
                str(peer.uncovered),
                f"{f.ratio:.0f}x",
            ]
        )
    return rows


def online_notes(figures: list[OnlineFigures]) -> list[str]:
    """What each column means and what is counted."""
    if not figures:
        return []
    counted = dict.fromkeys((peer.name, peer.counted) for f in figures for peer in f.peers)
    return [
        "law: clip included; sweep, fresh and chain are means per evaluation over many (known "
        "points again, each point once, each waiting for the value before); worst and cold are of "
        f"single points, the clock's {figures[0].timer_ns:.0f} ns included; cold: 4 MiB of other "
        "memory written before",
        "peers: mean, median and worst over the points of the least of three times per point; "
        "peer/law: mean over the law's sweep of the same points",
        *(f"{name}: {what}" for name, what in counted),
    ]


def offline_notes() -> list[str]:
    return [
        "processor time; explore: the critical regions, rows reduced, coverage proved by facets; "
        "structure: the evaluator and its proof",
        "regions: complete; at p5_u2 N = 5, 8, 10 and 20 four, four, two and two of "
        "them are thinner than 1e-6 of the half box, which others may leave out",
        "PPOPT: its fastest algorithm, rows reduced by itself; uncovered: random parameters that "
        "have a solution (judged by DAQP) and lie in no region",
    ]


def rich_table(title: str, columns: tuple[str, ...], rows: list[list[str]]) -> Table:
    table = Table(title=title)
    for k, name in enumerate(columns):
        table.add_column(name, justify="left" if k == 0 else "right")
    for row in rows:
        table.add_row(*row)
    return table


def markdown(
    title: str,
    machine: dict[str, Any],
    parts: list[tuple[tuple[str, ...], list[list[str]]]],
    notes: list[str],
) -> str:
    lines = [f"# {title}", "", machine_sentence(machine) + "."]
    for columns, rows in parts:
        lines += ["", "| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
        lines += ["| " + " | ".join(row) + " |" for row in rows]
    lines += ["", *(f"- {note}." for note in notes)]
    return "\n".join(lines) + "\n"


def as_json(machine: dict[str, Any], figures: list[OnlineFigures] | list[OfflineFigures]) -> Any:
    """Plain numbers and texts; what does not exist is null."""
    problems = []
    for f in figures:
        row = asdict(f)
        if isinstance(f, OfflineFigures):
            row["ratio"] = f.ratio
        problems.append(row)
    return _plain({"machine": machine, "problems": problems})


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _ns(value: float) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{value:.1f}" if value < 100.0 else f"{value:,.0f}"
