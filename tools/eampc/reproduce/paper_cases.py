"""What the paper prints of its two cases: set-up, numbers of figures and tables, running times."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperCase:
    """One case of section V; times are those of its table, in seconds per run."""

    number: int
    rig_name: str
    set_up: str
    first_figure: int  # EAMPC output, EAMPC input, min-max output, min-max input
    table: str
    eampc_s: tuple[float, ...]
    min_max_s: tuple[float, ...]


CASES = (
    PaperCase(
        number=1,
        rig_name="paper-case1",
        set_up="x(0) = (0, −1), u0 = 2, d = sin(x1 + x2), y_r = 1",
        first_figure=2,
        table="II",
        eampc_s=(6.58, 6.69, 6.65, 7.05, 6.64),
        min_max_s=(161.57, 161.45, 161.37, 164.05, 161.12),
    ),
    PaperCase(
        number=2,
        rig_name="paper-case2",
        set_up="x(0) = (1, 0), u0 = 0, d = 0.5 cos(x1 + x2), y_r = 0.5",
        first_figure=6,
        table="III",
        eampc_s=(6.57, 6.68, 6.66, 6.58, 6.65),
        min_max_s=(159.17, 159.45, 158.85, 160.16, 159.44),
    ),
)
