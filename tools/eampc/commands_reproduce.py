"""`eampc reproduce`: the paper's two cases with both controllers, as figures, tables and a page."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eampc.reproduce.paper_runs import CaseResult


class CaseChoice(StrEnum):
    ONE = "1"
    TWO = "2"
    ALL = "all"


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc reproduce -o reports/paper")(reproduce)


def reproduce(
    case: Annotated[CaseChoice, typer.Option("--case", help="Which case.")] = CaseChoice.ALL,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for page and figures.")
    ] = Path("reports/paper"),
    runs: Annotated[int, typer.Option("--runs", min=1, help="Timed runs of each controller.")] = 5,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.05, help="Simulated time of a run.")
    ] = 10.0,
    rigs: Annotated[
        Path, typer.Option("--rigs", metavar="DIR", help="Folder of the ready rigs.")
    ] = Path("rigs"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Compare EAMPC with min-max MPC as the paper does.

    Both cases in closed loop, as figures 2 to 9, tables II and III and a page (Markdown, HTML).

    Exit status 1 if an EAMPC curve does not settle within its rig's tolerance.
    """
    from eampc.hil.report_folder import make_folder
    from eampc.reproduce.paper_figures import write_case_figures
    from eampc.reproduce.paper_page import summary_of, write_page

    results = _run_cases(case, rigs, seconds, runs)
    folder = make_folder(output)
    figures = {result.case.number: write_case_figures(result, folder) for result in results}
    page = write_page(results, figures, folder)
    if as_json:
        typer.echo(json.dumps({"page": str(page), **summary_of(results)}))
    else:
        _print_tables(results, page)
    if any(result.settles is False for result in results):
        raise typer.Exit(1)


def _run_cases(case: CaseChoice, rigs: Path, seconds: float, runs: int) -> list[CaseResult]:
    from eampc.reproduce.paper_cases import CASES
    from eampc.reproduce.paper_runs import run_case
    from eampc.terminal import progress_bar

    chosen = [entry for entry in CASES if case in (CaseChoice.ALL, str(entry.number))]
    results = []
    with progress_bar() as bar:
        for entry in chosen:
            task = bar.add_task(f"case {entry.number}", total=None)

            def report(step: str, done: int, whole: int, task=task, entry=entry) -> None:
                bar.update(
                    task, description=f"case {entry.number}: {step}", completed=done, total=whole
                )

            results.append(run_case(entry, rigs, seconds, runs, report))
    return results


def _print_tables(results: list[CaseResult], page: Path) -> None:
    from rich.table import Table

    from eampc.reproduce.paper_tables import curve_table, step_table, time_table
    from eampc.terminal import output_console

    console = output_console()
    for result in results:
        for table in (curve_table(result), time_table(result), step_table(result)):
            shown = Table(title=table.title, title_justify="left", title_style="bold")
            for k, name in enumerate(table.heading):
                shown.add_column(name, justify="left" if k == 0 else "right")
            for row in table.rows:
                shown.add_row(*row)
            console.print(shown)
    console.print(f"page: {page}")
