"""The `eampc` command: one sentence for what a user can mend, exit code 0 done, 1 result not met, 2
bad input.
"""

import importlib.metadata
import os
import sys
from typing import Annotated

import typer

from eampc import (
    commands_bench,
    commands_certify,
    commands_check,
    commands_design,
    commands_emulate,
    commands_export,
    commands_hil,
    commands_mpqp,
    commands_operator,
    commands_reproduce,
    commands_telemetry,
    commands_verify,
)
from eampc.errors import UserError

NOT_MET, BAD_INPUT, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    name="eampc",
    help="Explicit adaptive MPC of a pneumatic-muscle joint: design the law, run it, watch it.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit status: 0 done, 1 a result was not met, 2 bad input. "
    "Start with: eampc demo rigs/reference",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"eampc {importlib.metadata.version('eampc')}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None: ...


commands_bench.register(app)
commands_design.register(app)
commands_certify.register(app)
commands_hil.register(app)
commands_check.register(app)
commands_emulate.register(app)
commands_export.register(app)
commands_operator.register(app)
commands_telemetry.register(app)
commands_reproduce.register(app)
commands_verify.register(app)
commands_mpqp.register(app)


def main() -> None:
    """Entry point of the `eampc` script."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Exit code of one command line; errors that a user can mend are told in one sentence."""
    try:
        code = app(arguments, prog_name="eampc", standalone_mode=False)
        sys.stdout.flush()
        if code == INTERRUPTED:  # Typer makes an exit code of Ctrl-C
            return _tell("interrupted", INTERRUPTED)
    except UserError as error:
        return _tell(error, error.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        return _tell("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader of a pipe had enough (| head); nothing more may be written, at exit neither.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if _is_rig_error(error):
            return _tell(error, BAD_INPUT)
        # Typer's usage errors have these two; where its classes live depends on its version.
        if not (hasattr(error, "format_message") and hasattr(error, "exit_code")):
            raise
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message(), file=sys.stderr)
            return BAD_INPUT
        return _tell(_usage_sentence(error), BAD_INPUT)
    return code if isinstance(code, int) else 0


def _is_rig_error(error: Exception) -> bool:
    # Imported only now: half of the start-up time, and most commands have no rig file.
    from eampc_rig import RigError

    return isinstance(error, RigError)


def _usage_sentence(error: Exception) -> str:
    text = str(error.format_message()).strip().rstrip(".")  # type: ignore[attr-defined]
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "eampc"
    return f"{text[:1].lower()}{text[1:]}; see {command} --help"


def _tell(error: object, code: int) -> int:
    sentence = " ".join(str(error).split())
    print(f"eampc: {sentence}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
