"""What the commands show: tables on a terminal or a pipe, a progress bar on standard error."""

import sys

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

# A pipe has no width; the table of `eampc hil` needs this much.
PIPE_WIDTH = 130


def output_console() -> Console:
    """Standard output; plain text of a fixed width if it is a pipe or a file."""
    terminal = sys.stdout.isatty()
    return Console(highlight=False, soft_wrap=not terminal, width=None if terminal else PIPE_WIDTH)


def progress_bar(wanted: bool = True) -> Progress:
    """A bar that is gone when the work is done, and never in a log file."""
    return Progress(
        TextColumn("{task.description:8}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not wanted or not sys.stderr.isatty(),
    )
