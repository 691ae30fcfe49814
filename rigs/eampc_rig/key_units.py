"""Units that the key names of a rig file end in."""

from __future__ import annotations

# Longest first: the first that fits is the unit. Suffixes in lower-case are compared as written.
UNIT_SUFFIXES: tuple[tuple[str, str], ...] = (
    ("_rad_s2_sqrt_Hz", "rad/s²·√Hz"),
    ("_rad_s_sqrt_Hz", "rad/s·√Hz"),
    ("_N_m_s_rad", "N m s/rad"),
    ("_N_per_MPa", "N/MPa"),
    ("_MPa_per_V", "MPa/V"),
    ("_per_rad_s2", "1/(rad s²)"),
    ("_per_s3", "1/s³"),
    ("_per_s2", "1/s²"),
    ("_V_per_s", "V/s"),
    ("_per_s", "1/s"),
    ("_kg_m2", "kg m²"),
    ("_rad_s3", "rad/s³"),
    ("_rad_s2", "rad/s²"),
    ("_rad_s", "rad/s"),
    ("_rad", "rad"),
    ("_N_m", "N m"),
    ("_kPa", "kPa"),
    ("_hz", "Hz"),
    ("_N", "N"),
    ("_V", "V"),
    ("_m", "m"),
    ("_s", "s"),
)

# Endings that people write instead; only for guessing what an unknown key meant.
FOREIGN_SUFFIXES: tuple[str, ...] = (
    "_deg_s2", "_deg_s", "_deg_per_s", "_rad_per_s2", "_rad_per_s", "_Nm_s_rad", "_N_per_kPa",
    "_kPa_per_V", "_bar_per_V", "_V_per_ms", "_kg_mm2", "_kgm2", "_degrees", "_seconds",
    "_deg", "_Nm", "_mPa", "_MPa", "_Pa", "_bar", "_kHz", "_Hz", "_kN", "_mV", "_volts", "_ms",
    "_us", "_ns", "_min", "_mm", "_cm", "_sec",
)  # fmt: skip


def unit_of(key: str) -> str | None:
    """Return the unit that `key` ends in ("period_s" → "s"), or None for a bare number."""
    return next((unit for suffix, unit in UNIT_SUFFIXES if key.endswith(suffix)), None)


def stem_of(key: str) -> str:
    """Return `key` without its unit, right or wrong ("period_ms" → "period")."""
    suffixes = sorted((*FOREIGN_SUFFIXES, *(s for s, _ in UNIT_SUFFIXES)), key=len, reverse=True)
    for suffix in suffixes:
        if key.lower().endswith(suffix.lower()) and len(key) > len(suffix):
            return key[: -len(suffix)]
    return key


def with_unit(key: str) -> str:
    """Return "key (unit s)", or the key alone if it has no unit."""
    unit = unit_of(key)
    return f"{key} (unit {unit})" if unit else key
