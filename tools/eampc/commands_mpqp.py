"""`eampc mpqp`: a multiparametric QP from a file, solved explicitly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from eampc.mpqp import Solution


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc mpqp problem.npz -o solution.npz")(mpqp)


def mpqp(
    problem: Annotated[
        Path,
        typer.Argument(metavar="PROBLEM.npz", help="Arrays H, F, f, G, w, S, lower, upper."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="SOLUTION.npz", help="Solution file to write."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
    threads: Annotated[
        int, typer.Option("--threads", metavar="N", min=0, help="Threads; 0: one per core.")
    ] = 0,
    time_limit_s: Annotated[
        float | None,
        typer.Option("--time-limit", metavar="S", help="Give up after this many seconds."),
    ] = None,
    max_regions: Annotated[
        int, typer.Option("--max-regions", metavar="N", min=1, help="Give up beyond N regions.")
    ] = 1_000_000,
    no_progress: Annotated[bool, typer.Option("--no-progress", help="No progress bar.")] = False,
) -> None:
    """Solve any multiparametric QP explicitly.

    min ½U'HU + (F p + f)'U, G U ≤ w + S p, for every p from lower to upper at once.
    """
    from eampc import mpqp as solver
    from eampc.terminal import output_console, progress_bar

    if output is not None and not output.parent.is_dir():
        raise solver.MpqpError(
            f"{output}: the folder {output.parent} does not exist; make it first"
        )
    loaded = solver.load_problem(problem)
    with progress_bar(not no_progress) as bar:
        task = bar.add_task("regions", total=None)
        solution = solver.solve(
            *loaded[:6],
            (loaded.lower, loaded.upper),
            threads=threads,
            time_limit_s=time_limit_s,
            max_regions=max_regions,
            progress=lambda done, known: bar.update(task, completed=done, total=known),
        )
    if output is not None:
        solution.save(output)
    figures = {"problem": str(problem), "output": str(output or ""), **figures_of(solution)}
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        output_console().print(_table(figures))


def figures_of(solution: Solution) -> dict[str, object]:
    """The figures of the table and of --json."""
    rows, variables = solution.problem.G.shape
    return {
        "variables": variables,
        "parameters": len(solution.problem.lower),
        "rows": rows,
        **solution.statistics,
        "least_radius": float(solution.arrays["radius"].min()),
        "facets": len(solution.arrays["facet_offsets"]),
    }


def _table(figures: dict[str, object]) -> Table:
    from rich.table import Table

    table = Table(show_header=False, box=None)
    for key, value in figures.items():
        if value != "":
            shown = f"{value:.4g}" if isinstance(value, float) else str(value)
            table.add_row(key.replace("_", " "), shown)
    return table
