"""What happens in a run: sections [scenarios.NAME], with reference, disturbance and tolerance."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from eampc_rig.field_types import Name, NonNegative, Positive, Section


class ConstantReference(Section):
    """y_r = amplitude."""

    kind: Literal["constant"]
    amplitude_rad: float


class StepReference(Section):
    """y_r = offset before start, offset + amplitude from start on."""

    kind: Literal["step"]
    amplitude_rad: float
    start_s: NonNegative = 0.0
    offset_rad: float = 0.0


class SineReference(Section):
    """y_r = offset before start, offset + amplitude · sin(2π f (t − start)) from start on."""

    kind: Literal["sine"]
    amplitude_rad: float
    frequency_hz: Positive
    start_s: NonNegative = 0.0
    offset_rad: float = 0.0


class CsvReference(Section):
    """A table: columns time_s, angle_rad[, velocity_rad_s, acceleration_rad_s2]."""

    kind: Literal["csv"]
    file: Name


Reference = Annotated[
    ConstantReference | StepReference | SineReference | CsvReference, Field(discriminator="kind")
]


class ConstantTerm(Section):
    """d = amplitude."""

    kind: Literal["constant"]
    amplitude_rad_s2: float


class StepTerm(Section):
    """d = amplitude from start on."""

    kind: Literal["step"]
    amplitude_rad_s2: float
    start_s: NonNegative = 0.0


class SineTerm(Section):
    """d = amplitude · sin(2π f t)."""

    kind: Literal["sine"]
    amplitude_rad_s2: float
    frequency_hz: Positive


class SineOfStateSumTerm(Section):
    """d = amplitude · sin(x1 + x2), the paper's case 1."""

    kind: Literal["sine_of_state_sum"]
    amplitude_rad_s2: float


class CosineOfStateSumTerm(Section):
    """d = amplitude · cos(x1 + x2), the paper's case 2."""

    kind: Literal["cosine_of_state_sum"]
    amplitude_rad_s2: float


class PulseTerm(Section):
    """d = amplitude from start to end, the end excluded."""

    kind: Literal["pulse"]
    amplitude_rad_s2: float
    start_s: NonNegative
    end_s: Positive


DisturbanceTerm = Annotated[
    ConstantTerm | StepTerm | SineTerm | SineOfStateSumTerm | CosineOfStateSumTerm | PulseTerm,
    Field(discriminator="kind"),
]


class Tolerance(Section):
    """What a run of the scenario must meet; an absent maximum is not checked."""

    rms_from_s: NonNegative = 0.0
    rms_error_max_rad: Positive | None = None
    max_error_max_rad: Positive | None = None
    final_error_max_rad: Positive | None = None


class Scenario(Section):
    """Section [scenarios.NAME]. Times count from the cycle in which the daemon becomes ACTIVE."""

    duration_s: Positive
    reference: Reference
    disturbance: Annotated[tuple[DisturbanceTerm, ...], Field(strict=False)] = ()
    tolerance: Tolerance = Tolerance()
