"""`eampc verify`: the closed loop against thousands of random plants, in compiled code."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eampc.rig_arguments import RigArgument, SetOption, VariantOption

if TYPE_CHECKING:
    from eampc_rig import Rig

    from eampc.law import Law
    from eampc.verification import CampaignSettings, Verification
    from eampc.verification_report import ReplayCommand

MOST_TRIALS = 10_000_000
DEFAULT_SECONDS = 2.0


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc verify rigs/reference --trials 10000 -o verify.md")(verify)


def verify(
    rig: RigArgument,
    trials: Annotated[
        int, typer.Option("--trials", min=1, max=MOST_TRIALS, help="How many random plants.")
    ] = 10_000,
    seconds: Annotated[
        float, typer.Option("--seconds", help="Length of a trial, with the law in charge.")
    ] = DEFAULT_SECONDS,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the whole campaign.")] = 1,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            "--tolerance",
            metavar="NAME=PERCENT",
            help="Of J, b, b1 (20%), b_v, tau_v (50%): J=10%; repeatable.",
        ),
    ] = None,
    threads: Annotated[int, typer.Option("--threads", min=0, help="0: one per core.")] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="Spread it over this Dask scheduler's workers."
        ),
    ] = None,
    replay: Annotated[
        int | None,
        typer.Option("--replay", metavar="INDEX", min=0, help="Run this one trial again instead."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE.png", help="Of the replayed trial.")
    ] = None,
    law: Annotated[
        Path | None,
        typer.Option(
            "--law",
            metavar="FILE",
            help="Law file. Default: designed once, kept in ~/.cache/eampc.",
        ),
    ] = None,
    variant: VariantOption = None,
    changes: SetOption = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="State bounds and faults count for the exit status.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.md", help="Markdown report.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Run the daemon's control cycle against random plants.

    Exit status 0 if no voltage left its range or its slew limit and all stayed finite; trials that
    left the state bounds are listed, and count only with --strict.
    """
    from eampc_rig import load_rig, parse_override

    from eampc.errors import UserError
    from eampc.verification import campaign_settings

    if figure is not None and replay is None:
        raise UserError("--figure draws one trial; name it with --replay INDEX")
    for path in filter(None, (figure, report)):
        if not path.parent.is_dir():
            raise UserError(f"{path}: the folder {path.parent} does not exist; make it first")
    loaded = load_rig(rig, variant, dict(parse_override(change) for change in changes or []))
    tolerances = dict(_tolerance(text) for text in tolerance or [])
    settings = campaign_settings(loaded, seconds=seconds, seed=seed, tolerances=tolerances)
    checked = _law(loaded, law)

    options = _given(seed, seconds, tolerance, changes, variant, law)

    def command(index: int) -> str:
        words = ["eampc", "verify", str(rig), *options, "--replay", str(index)]
        return shlex.join([*words, "--figure", f"trial-{index}.png"])

    if replay is None:
        found = _run(loaded, checked, settings, trials, threads, scheduler)
    else:
        found = _replay(loaded, checked, settings, replay, figure, as_json)
    title = f"Monte-Carlo verification of {loaded.rig.name}" + (f" ({variant})" if variant else "")
    _tell(found, title, command, report, as_json, replay is not None)
    held = not any(found.hard_violations.values())
    if strict:
        held = held and not (found.beyond_state_bounds.size or found.faulted.size)
    if not held:
        raise typer.Exit(1)


def _given(
    seed: int,
    seconds: float,
    tolerance: list[str] | None,
    changes: list[str] | None,
    variant: str | None,
    law: Path | None,
) -> list[str]:
    """The options that a replay must repeat."""
    options = ["--seed", str(seed)]
    if seconds != DEFAULT_SECONDS:
        options += ["--seconds", f"{seconds!r}"]
    for name, values in (
        ("--tolerance", tolerance),
        ("--set", changes),
        ("--variant", [variant] if variant else []),
        ("--law", [str(law)] if law else []),
    ):
        for value in values or []:
            options += [name, value]
    return options


def _tolerance(text: str) -> tuple[str, float]:
    from eampc.errors import UserError

    name, _, number = text.partition("=")
    percent = number.endswith("%")
    try:
        value = float(number.removesuffix("%"))
    except ValueError:
        raise UserError(f"--tolerance {text}: write NAME=PERCENT, as J=20%") from None
    return name.strip(), value / 100.0 if percent else value


def _law(rig: Rig, path: Path | None) -> Law:
    from eampc.commands_design import design_with_progress
    from eampc.hil.law_choice import cached_law, checked_law
    from eampc.law import load_law

    if path is not None:
        return load_law(checked_law(path, rig))
    return load_law(cached_law(rig, lambda kept: design_with_progress(rig).save(kept)))


def _run(
    rig: Rig,
    law: Law,
    settings: CampaignSettings,
    trials: int,
    threads: int,
    scheduler: str | None,
) -> Verification:
    from eampc.terminal import progress_bar
    from eampc.verification import verify as verify_trials

    with progress_bar() as bar:
        task = bar.add_task("trials", total=trials)
        return verify_trials(
            rig,
            law,
            settings,
            trials,
            threads=threads,
            progress=lambda done: bar.update(task, completed=done),
            scheduler=scheduler,
        )


def _replay(
    rig: Rig,
    law: Law,
    settings: CampaignSettings,
    index: int,
    figure: Path | None,
    as_json: bool,
) -> Verification:
    from eampc.verification import replay as replay_trial

    found, cycles, drawn = replay_trial(rig, law, settings, index)
    if figure is not None:
        from eampc.verification_report import trial_figure

        trial_figure(
            figure, cycles, settings, f"{rig.rig.name}: seed {settings.seed}, trial {index}"
        )
    if not as_json:
        for part, numbers in drawn.items():
            values = (
                f"{name} = {value:.6g}" if isinstance(value, float) else f"{name} = {value}"
                for name, value in numbers.items()
            )
            typer.echo(f"{part}: {', '.join(values)}")
    return found


def _tell(
    found: Verification,
    title: str,
    command: ReplayCommand,
    report: Path | None,
    as_json: bool,
    replayed: bool,
) -> None:
    from eampc import verification_report as reports
    from eampc.terminal import output_console

    if report is not None:
        report.write_text(reports.markdown_report(title, found, command), encoding="utf-8")
    if as_json:
        typer.echo(json.dumps(reports.verification_summary(found, command)))
        return
    console = output_console()
    if not replayed:
        for sentence in reports.campaign_sentences(found.settings):
            console.print(sentence, markup=False)
        console.print(reports.speed_sentence(found))
    console.print(reports.worst_table(found))
    if not replayed:
        for index in dict.fromkeys(row.index for row in reports.worst_cases(found)):
            console.print(f"replay {index}: {command(index)}")
    for sentence in reports.verdict_sentences(found):
        console.print(sentence)
    if found.beyond_state_bounds.size and not replayed:
        console.print(
            f"trials beyond the state bounds: {reports.indices(found.beyond_state_bounds)}"
        )
    if report is not None:
        console.print(f"report: {report}")
