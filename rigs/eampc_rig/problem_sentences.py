"""One sentence for each thing wrong with a rig file: key, problem, mend."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ValidationError

from eampc_rig.key_tables import all_keys, keys_at, model_at, without_tags
from eampc_rig.key_units import stem_of, unit_of, with_unit

_TYPE_WORDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a string",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "tuple_type": "a list",
    "finite_number": "a finite number",
}
_RELATIONS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def dotted(path: Iterable[Any]) -> str:
    """Return ("scenarios", "step", 0) as "scenarios.step.0"."""
    return ".".join(str(part) for part in path)


def nearest(word: str, candidates: Iterable[str]) -> str | None:
    """Return the candidate that `word` was probably meant to be, or None."""
    by_lower = {candidate.lower(): candidate for candidate in candidates}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    if not close and len(word) >= 4:
        close = [candidate for candidate in by_lower if word.lower() in candidate]
    return by_lower[close[0]] if close else None


def sentences(root: type[BaseModel], raw: dict[str, Any], error: ValidationError) -> list[str]:
    """Return what is wrong, most telling first: unknown keys, then values, then missing keys.

    A missing key that an unknown one was probably meant to be is not reported twice.
    """
    unknown: list[str] = []
    missing: list[tuple[str, str]] = []
    values: list[str] = []
    meant: set[str] = set()
    for item in error.errors():
        path = without_tags(root, item["loc"], raw)
        if item["type"] == "extra_forbidden":
            text, suggestion = _unknown_key(root, raw, path)
            unknown.append(text)
            if suggestion:
                meant.add(suggestion)
        elif item["type"] == "missing":
            key = dotted(path)
            missing.append((key, f"{key} is missing; add {_wanted(root, raw, path)}"))
        else:
            values.append(_wrong_value(path, dict(item)))
    return unknown + values + [text for key, text in missing if key not in meant]


def _unknown_key(
    root: type[BaseModel], raw: dict[str, Any], path: tuple[Any, ...]
) -> tuple[str, str | None]:
    text = f"{dotted(path)} is not a key of this file"
    *table, name = path
    siblings = keys_at(root, tuple(table), raw)
    found = _meant(str(name), siblings)
    if found is not None:
        suggestion = dotted((*table, found))
        return f"{text}; did you mean {with_unit(suggestion)}?", suggestion
    elsewhere = [key for key in all_keys(root) if key[-1] == name]
    if elsewhere:
        suggestion = dotted(elsewhere[0])
        return f"{text}; did you mean {with_unit(suggestion)}?", suggestion
    if siblings:
        where = f"[{dotted(table)}]" if table else "the file"
        return f"{text}; remove it, or use one that {where} has: {', '.join(siblings)}", None
    return f"{text}; remove it", None


def _meant(name: str, siblings: list[str]) -> str | None:
    same_stem = [key for key in siblings if stem_of(key).lower() == stem_of(name).lower()]
    if same_stem:
        return nearest(name, same_stem) or same_stem[0]
    return nearest(name, siblings)


def _wanted(root: type[BaseModel], raw: dict[str, Any], path: tuple[Any, ...]) -> str:
    if model_at(root, path, raw) is not None:
        return f"the table [{dotted(path)}]"
    unit = unit_of(str(path[-1]))
    return f"it (unit {unit})" if unit else "it"


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, (list, tuple)):
        return "a list"
    return str(value)


def _wrong_value(path: tuple[Any, ...], item: dict[str, Any]) -> str:
    kind, context, key = item["type"], item.get("ctx", {}), dotted(path)
    unit = unit_of(str(path[-1])) if path else None
    in_unit = f" {unit}" if unit else ""
    value = item["input"]
    if kind in _RELATIONS:
        limit, words = _RELATIONS[kind]
        return f"{key} is {_shown(value)}{in_unit}, but must be {words} {context[limit]}{in_unit}"
    if kind in _TYPE_WORDS:
        of_unit = f" (unit {unit})" if unit else ""
        return f"{key} is {_shown(value)}, but must be {_TYPE_WORDS[kind]}{of_unit}"
    if kind == "literal_error":
        choices = context["expected"].replace("'", '"')
        found = nearest(str(value), [c.strip('", ') for c in choices.split('"')[1::2]])
        return f"{key} is {_shown(value)}, but must be {choices}" + _did_you_mean(found)
    if kind == "union_tag_invalid":
        names = context["expected_tags"].replace("'", "").split(", ")
        found = nearest(str(context["tag"]), names)
        choices = ", ".join(f'"{name}"' for name in names)
        text = f'{key}.kind is "{context["tag"]}", but must be one of {choices}'
        return text + _did_you_mean(found)
    if kind == "union_tag_not_found":
        return f"{key}.kind is missing; add which kind it is"
    if kind == "string_too_short":
        return f"{key} is empty; give it a name"
    message = str(item["msg"])
    return f"{key} is {_shown(value)}: {message[:1].lower()}{message[1:]}"


def _did_you_mean(found: str | None) -> str:
    return f'; did you mean "{found}"?' if found else ""
