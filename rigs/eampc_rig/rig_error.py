"""The one exception for a rig that cannot be used as described."""

from __future__ import annotations

from collections.abc import Sequence


class RigError(ValueError):
    """A rig file, DBC or bus URL is wrong; the text is one sentence that names place and mend.

    `problems` holds every problem found, one sentence each; the text shows the first and how
    many more there are.
    """

    def __init__(self, problems: str | Sequence[str]) -> None:
        self.problems: tuple[str, ...] = (
            (problems,) if isinstance(problems, str) else tuple(problems)
        )
        more = len(self.problems) - 1
        super().__init__(self.problems[0] + (f" (and {more} more)" if more else ""))
