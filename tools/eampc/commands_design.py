"""`eampc design` and `eampc law show`: rig → law file, law file → text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eampc.rig_arguments import RigArgument, SetOption, VariantOption

if TYPE_CHECKING:
    from eampc_rig import Rig

    from eampc.law import Law


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc design rigs/reference -o rig.law")(design)
    law_app = typer.Typer(
        help="Look into law files.",
        no_args_is_help=True,
        rich_markup_mode=None,
        epilog="Example: eampc law show rig.law",
    )
    law_app.command(epilog="Example: eampc law show rig.law")(show)
    app.add_typer(law_app, name="law")


def design(
    rig: RigArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="PATH", help="Law file to write.")
    ],
    variant: VariantOption = None,
    changes: SetOption = None,
    no_certificate: Annotated[
        bool, typer.Option("--no-certificate", help="Write the law without proving it.")
    ] = False,
    no_progress: Annotated[bool, typer.Option("--no-progress", help="No progress bar.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the law's figures as JSON.")
    ] = False,
) -> None:
    """Design a rig's explicit law into one file."""
    from eampc_rig import load_rig, parse_override

    from eampc.errors import DesignError
    from eampc.law_report import law_summary, summary_table
    from eampc.terminal import output_console

    loaded = load_rig(rig, variant, dict(parse_override(change) for change in changes or []))
    if not output.parent.is_dir():
        raise DesignError(f"{output}: the folder {output.parent} does not exist; make it first")
    law = design_with_progress(loaded, not no_progress, not no_certificate)
    size_bytes = law.save(output)
    if as_json:
        typer.echo(json.dumps({"path": str(output), **law_summary(law)}))
    else:
        output_console().print(summary_table(law, str(output), size_bytes))


def design_with_progress(rig: Rig, shown: bool = True, certificate: bool = True) -> Law:
    """The rig's law, designed (and proved, with `certificate`) under a progress bar."""
    from eampc.law_design import design as design_law
    from eampc.terminal import progress_bar

    with progress_bar(shown) as bar:
        task = bar.add_task("law", total=None)

        def report(step: str, done: int, known: int) -> None:
            bar.update(task, description=f"law: {step}", completed=done, total=known or None)

        return design_law(rig, report, certificate)


def show(
    law: Annotated[Path, typer.Argument(metavar="FILE", help="Law file.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Print what a law file holds."""
    from eampc.law import load_law
    from eampc.law_report import law_summary, print_law
    from eampc.terminal import output_console

    loaded = load_law(law)
    if as_json:
        typer.echo(json.dumps(law_summary(loaded)))
    else:
        print_law(loaded, output_console())
