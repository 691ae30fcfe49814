"""One line of the checklist."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Finding:
    """What was looked at, what was found, and what to do about it.

    ok      True: as it should be; False: not; None: worth knowing, neither right nor wrong
    remedy  what to do, one sentence; only where ok is False
    """

    topic: str
    found: str
    ok: bool | None = None
    remedy: str = ""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def judged(topic: str, ok: bool, found: str, remedy: str) -> Finding:
    return Finding(topic, found, ok, "" if ok else remedy)
