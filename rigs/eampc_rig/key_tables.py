"""Which keys a rig file may have where: the schema seen as tables of dotted keys."""

from __future__ import annotations

import types
import typing
from typing import Annotated, Any, Union

from pydantic import BaseModel


def model_at(root: type[BaseModel], path: tuple[Any, ...], raw: Any) -> type[BaseModel] | None:
    """Return the section class at `path` of the raw file, or None if no table belongs there."""
    annotation: Any = root
    for part in path:
        annotation = _step(annotation, part, raw)
        if annotation is None:
            return None
        raw = _child(raw, part)
    found = _tables(annotation, raw)
    return found[0] if found else None


def keys_at(root: type[BaseModel], path: tuple[Any, ...], raw: Any) -> list[str]:
    """Return the keys that the table at `path` may have; empty if no table belongs there."""
    model = model_at(root, path, raw)
    return [] if model is None else list(model.model_fields)


def all_keys(root: type[BaseModel]) -> list[tuple[str, ...]]:
    """Return every fixed key of the schema as a path; scenario and variant tables are left out."""
    found: list[tuple[str, ...]] = []

    def visit(model: type[BaseModel], prefix: tuple[str, ...]) -> None:
        for name, field in model.model_fields.items():
            inner = _unwrap(field.annotation)
            if len(inner) == 1 and _is_model(inner[0]):
                visit(inner[0], (*prefix, name))
            else:
                found.append((*prefix, name))

    visit(root, ())
    return found


def without_tags(root: type[BaseModel], location: tuple[Any, ...], raw: Any) -> tuple[Any, ...]:
    """Return pydantic's error location without the names of the union members it passed."""
    path: list[Any] = []
    node = raw
    for index, part in enumerate(location):
        is_last = index == len(location) - 1
        kind = node.get("kind") if isinstance(node, dict) else None
        if isinstance(node, dict) and part == kind and part not in node:
            members = model_at(root, tuple(path), raw)
            if not is_last or (members is not None and part not in members.model_fields):
                continue
        path.append(part)
        node = _child(node, part)
    return tuple(path)


def _child(raw: Any, part: Any) -> Any:
    if isinstance(raw, dict):
        return raw.get(part)
    if isinstance(raw, list) and isinstance(part, int) and 0 <= part < len(raw):
        return raw[part]
    return None


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _unwrap(annotation: Any) -> list[Any]:
    origin = typing.get_origin(annotation)
    if origin is Annotated:
        return _unwrap(typing.get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        members = [m for m in typing.get_args(annotation) if m is not type(None)]
        return [inner for member in members for inner in _unwrap(member)]
    return [annotation]


def _tables(annotation: Any, raw: Any) -> list[type[BaseModel]]:
    models = [m for m in _unwrap(annotation) if _is_model(m)]
    kind = raw.get("kind") if isinstance(raw, dict) else None
    chosen = [
        m
        for m in models
        if "kind" in m.model_fields and kind in typing.get_args(m.model_fields["kind"].annotation)
    ]
    return chosen or models


def _step(annotation: Any, part: Any, raw: Any) -> Any:
    for candidate in _unwrap(annotation):
        origin = typing.get_origin(candidate)
        if origin is dict:
            return typing.get_args(candidate)[1]
        if origin is tuple and isinstance(part, int):
            return typing.get_args(candidate)[0]
    for model in _tables(annotation, raw):
        if part in model.model_fields:
            field = model.model_fields[part]
            return field.annotation
    return None
