"""The rig file: rig.toml in, a checked and frozen `Rig` out."""

from __future__ import annotations

import hashlib
import json
import tomllib
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr, ValidationError

from eampc_rig.bus_sections import BusSection
from eampc_rig.control_sections import (
    ConstraintsSection,
    ControlSection,
    EstimatorSection,
    ModelSection,
    ParameterBoxSection,
    TelemetrySection,
    TighteningSection,
)
from eampc_rig.field_types import Section
from eampc_rig.overrides import apply_overrides, apply_variant
from eampc_rig.plant_sections import (
    EmulatorSection,
    JointSection,
    MuscleSection,
    RigSection,
    ValveSection,
)
from eampc_rig.problem_sentences import nearest, sentences
from eampc_rig.rig_error import RigError
from eampc_rig.safety_section import SafetySection
from eampc_rig.scenario_sections import Scenario

# These tables never reach the law: a law stays valid when they change.
NOT_DESIGN_INPUTS = ("emulator", "scenarios")


class Rig(Section):
    """A checked rig: one attribute per section of the file, as `rig.control.period_s`."""

    rig: RigSection
    joint: JointSection
    muscle: MuscleSection
    valve: ValveSection
    model: ModelSection = ModelSection()
    control: ControlSection
    constraints: ConstraintsSection
    tightening: TighteningSection = TighteningSection()
    estimator: EstimatorSection = EstimatorSection()
    parameter_box: ParameterBoxSection = ParameterBoxSection()
    bus: BusSection
    safety: SafetySection = SafetySection()
    telemetry: TelemetrySection = TelemetrySection()
    emulator: EmulatorSection = EmulatorSection()
    scenarios: dict[str, Scenario] = Field(default_factory=dict)

    _file: Path = PrivateAttr(default=Path("rig.toml"))
    _variant: str | None = PrivateAttr(default=None)
    _variants: tuple[str, ...] = PrivateAttr(default=())
    _inputs: bytes = PrivateAttr(default=b"")

    @property
    def file(self) -> Path:
        """The rig.toml that was read."""
        return self._file

    @property
    def folder(self) -> Path:
        """The folder that rig.toml lies in; file names in it are relative to this."""
        return self._file.parent

    @property
    def dbc_path(self) -> Path:
        """The DBC that bus.dbc names."""
        return self.folder / self.bus.dbc

    @property
    def variant(self) -> str | None:
        """The variant that was applied, or None."""
        return self._variant

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the variants that the file offers."""
        return self._variants

    @property
    def control_max(self) -> float:
        """Largest |u| of equation (1): what keeps both valves in [min_V, max_V], or less if set."""
        if self.constraints.control_max is not None:
            return self.constraints.control_max
        return self.control_range

    @property
    def control_range(self) -> float:
        """min(u0 − u_min, u_max − u0) / ku: the |u| at which the first valve meets its limit."""
        v = self.valve
        return min(v.bias_V - v.min_V, v.max_V - v.bias_V) / v.control_gain_V

    @property
    def emulated_muscle(self) -> MuscleSection:
        """The muscles of the emulated plant: (3), or its tangent with emulator.linear_muscles."""
        return self.muscle.linearised() if self.emulator.linear_muscles else self.muscle

    def scenario(self, name: str) -> Scenario:
        """The scenario called `name`; raises RigError if the file has none of that name."""
        if name not in self.scenarios:
            found = nearest(name, self.scenarios)
            there = ", ".join(self.scenarios) or "none"
            mend = f'did you mean "{found}"?' if found else f"it has {there}"
            raise RigError(f'{self.file}: there is no scenario "{name}"; {mend}')
        return self.scenarios[name]

    @property
    def inputs_sha256(self) -> str:
        """SHA-256 (hex) of what the law is designed from: effective values and the DBC's bytes."""
        return hashlib.sha256(self._inputs).hexdigest()

    @property
    def inputs_crc32(self) -> int:
        """CRC-32 of the same bytes as `inputs_sha256`."""
        return zlib.crc32(self._inputs)


def load_rig(
    path: str | Path, variant: str | None = None, overrides: Mapping[str, Any] | None = None
) -> Rig:
    """Read and check a rig file.

    `path` is a rig's folder or its rig.toml. The table variants.VARIANT is put over the file,
    then `overrides` ({"control.horizon": 20}); the value "absent" removes a key.
    Raises RigError, one sentence that names file, key, problem and mend.
    """
    from eampc_rig.cross_checks import contradictions
    from eampc_rig.frames import resolve_frames

    file = Path(path)
    if file.is_dir():
        file = file / "rig.toml"
    raw = _read(file)
    offered = raw.get("variants", {})
    names = tuple(offered) if isinstance(offered, dict) else ()
    if variant is None:
        raw = apply_overrides(raw, overrides or {}, str(file))
    else:
        raw = apply_variant(raw, variant, str(file), overrides or {})
    raw.pop("variants", None)
    try:
        rig = Rig.model_validate(raw)
    except ValidationError as error:
        found = sentences(Rig, raw, error)
        raise RigError([f"{file}: {text}" for text in found]) from None
    rig._file, rig._variant, rig._variants = file, variant, names
    found = contradictions(rig)
    if found:
        raise RigError([f"{file}: {text}" for text in found])
    resolve_frames(rig)
    rig._inputs = _inputs(rig)
    return rig


def _read(file: Path) -> dict[str, Any]:
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise RigError(f"{file}: there is no such file; give a rig's folder or rig.toml") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise RigError(f"{file}: cannot be read ({reason})") from None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RigError(f"{file}: is not valid TOML: {error}") from None


def _inputs(rig: Rig) -> bytes:
    values = rig.model_dump(mode="json", exclude=set(NOT_DESIGN_INPUTS))
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return text.encode("ascii") + b"\0" + rig.dbc_path.read_bytes()
