"""`eampc certify`: prove a law again from its file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc certify rig.law --report certificate.html")(certify)


def certify(
    law: Annotated[Path, typer.Argument(metavar="FILE", help="Law file.")],
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="PATH", help="Also write a page: .md or .html."),
    ] = None,
    threads: Annotated[
        int, typer.Option("--threads", min=0, help="Threads; 0: as many as the machine has.")
    ] = 0,
    no_progress: Annotated[bool, typer.Option("--no-progress", help="No progress bar.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Prove a law again, from its file alone.

    It is optimal and continuous, without holes, and evaluated as proved; the invariant set holds.

    Exit status: 0 proved, and as the file's own certificate says; 1 not; 2 bad input.
    """
    from eampc.certificate import certify as prove
    from eampc.certificate import difference_from_file
    from eampc.certificate_report import certificate_table, html_report, markdown_report
    from eampc.errors import LawFileError, RunFailed, UserError
    from eampc.law import load_law
    from eampc.terminal import output_console, progress_bar

    if report is not None and report.suffix not in (".md", ".html"):
        raise UserError(f"{report}: --report writes .md or .html; name the file accordingly")
    if report is not None and not report.parent.is_dir():
        raise UserError(f"{report}: the folder {report.parent} does not exist; make it first")
    loaded = load_law(law)
    with progress_bar(not no_progress) as bar:
        task = bar.add_task("proofs", total=None)

        def show(part: str, done: int, of: int) -> None:
            bar.update(task, description=f"proof of {part}", completed=done, total=of or None)

        try:
            certificate = prove(loaded, show, threads)
        except ValueError as error:
            raise LawFileError(f"{law}: {error}; design it again") from None
    difference = difference_from_file(certificate, loaded)
    if report is not None:
        page = html_report if report.suffix == ".html" else markdown_report
        report.write_text(page(certificate, loaded), encoding="utf-8")
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "path": str(law),
                    "proved": certificate.proved,
                    "failure": certificate.failure,
                    "difference_from_file": difference,
                    "seconds": round(certificate.seconds, 3),
                    **certificate.figures,
                }
            )
        )
    else:
        output_console().print(certificate_table(certificate, f"{law}: {loaded!r}"))
    if not certificate.proved:
        raise RunFailed(f"{law}: not proved: {certificate.failure}")
    if difference:
        raise RunFailed(f"{law}: proved, but {difference}; design it again")
