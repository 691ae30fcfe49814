"""Variants and single overrides: dotted keys put over the raw file before it is checked."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from typing import Any

from eampc_rig.problem_sentences import nearest
from eampc_rig.rig_error import RigError

ABSENT = "absent"


def parse_override(text: str) -> tuple[str, Any]:
    """Split "key=value" of a command line; the value is read as TOML, else taken as a string.

    Raises RigError if there is no "=" or no key.
    """
    key, equals, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not equals or not key:
        raise RigError(f'"{text}" is not an override; write key=value, as in control.horizon=20')
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value


def apply_variant(
    raw: dict[str, Any], name: str, file: str, overrides: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a copy of `raw` with the table variants.NAME put over it, then `overrides`.

    Raises RigError if the variant does not exist or a key leads through something not a table.
    """
    variants = raw.get("variants", {})
    if not isinstance(variants, dict) or name not in variants:
        names = list(variants) if isinstance(variants, dict) else []
        found = nearest(name, names)
        mend = f'did you mean "{found}"?' if found else f"it has {', '.join(names) or 'none'}"
        raise RigError(f'{file}: there is no variant "{name}"; {mend}')
    if not isinstance(variants[name], dict):
        raise RigError(f'{file}: variants.{name} must be a table of "dotted.key" = value')
    return apply_overrides(raw, {**_flat(variants[name]), **overrides}, file)


def apply_overrides(raw: dict[str, Any], overrides: Mapping[str, Any], file: str) -> dict[str, Any]:
    """Return a copy of `raw` with each dotted key set; the value "absent" removes the key.

    Raises RigError if a key leads through something that is not a table or a list.
    """
    result = copy.deepcopy(raw)
    for key, value in overrides.items():
        _set(result, key, copy.deepcopy(value), file)
    return result


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    # TOML reads estimator.kind = "kalman" without quotation marks as a nested table.
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and "." not in key and "kind" not in value:
            flat.update({f"{key}.{inner}": item for inner, item in _flat(value).items()})
        else:
            flat[key] = value
    return flat


def _set(node: Any, key: str, value: Any, file: str) -> None:
    *tables, last = key.split(".")
    for part in tables:
        if isinstance(node, dict):
            if part not in node and value == ABSENT:
                return
            node = node.setdefault(part, {})
        else:
            node = node[_position(node, part, key, file)]
    if isinstance(node, dict):
        if value == ABSENT:
            node.pop(last, None)
        else:
            node[last] = value
        return
    position = _position(node, last, key, file)
    if value == ABSENT:
        del node[position]
    else:
        node[position] = value


def _position(node: Any, part: str, key: str, file: str) -> int:
    if isinstance(node, list) and part.isdigit() and int(part) < len(node):
        return int(part)
    what = f"a list of {len(node)}" if isinstance(node, list) else "a single value"
    raise RigError(f'{file}: override {key} leads nowhere; "{part}" is looked up in {what}')
