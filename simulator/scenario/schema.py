"""The grammar of scenario files as a JSON Schema, from which editors complete keys and mark mistakes.

It is made from the fields that read a scenario, so the two cannot drift apart. What depends on several keys
at once, on files or on units is said only when a scenario is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from inspect import get_annotations
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator, BaseModel
from pydantic.fields import FieldInfo

from simulator.scenario.device import MaxwellPreset
from simulator.scenario.document import Scenario
from simulator.scenario.elastomer import Preset, Python
from simulator.scenario.fields import ByName, Chosen, Measured, not_empty
from simulator.scenario.presets import PRESETS

_Node = dict[str, Any]

_PLAIN: dict[Any, str] = {bool: "boolean", int: "integer", float: "number", str: "string"}
_LIMITS = {Ge: ("minimum", "ge"), Gt: ("exclusiveMinimum", "gt"), Le: ("maximum", "le")}


def scenario_schema() -> _Node:
    """The JSON Schema (draft 7) of a scenario file.

    Examples
    --------
    >>> schema = scenario_schema()
    >>> schema["required"], schema["definitions"]["Gas"]["required"]
    (['title', 'gas', 'balloon', 'step'], ['ambient_pressure'])
    """
    definitions: dict[str, _Node] = {}
    root = _table(Scenario, definitions)
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        **root,
        "title": "A scenario of the command balloons",
        "definitions": dict(sorted(definitions.items())),
    }


def _table(model: type[BaseModel], definitions: dict[str, _Node]) -> _Node:
    """A table of the file, with its keys."""
    fields = {field.alias or name: field for name, field in model.model_fields.items()}
    return {
        "type": "object",
        "description": " ".join((model.__doc__ or "").split("\n\n")[0].split()),
        "properties": {key: _field(field, definitions) for key, field in fields.items()},
        "required": [key for key, field in fields.items() if field.is_required()],
        "additionalProperties": _others(model, definitions),
    }


def _others(model: type[BaseModel], definitions: dict[str, _Node]) -> _Node | Literal[False]:
    """What may stand under the names of balloons."""
    if "__pydantic_extra__" not in model.__annotations__:
        return False
    kind = get_annotations(model, eval_str=True)["__pydantic_extra__"]
    return _reference(get_args(kind)[1], definitions)


def _field(field: FieldInfo, definitions: dict[str, _Node]) -> _Node:
    """A key of a table, with what it allows in words."""
    node = _value(field.annotation, field.metadata, definitions)
    if field.description:
        node = {"allOf": [node]} if "$ref" in node else node
        node = {**node, "description": field.description}
    if isinstance(field.default, bool | int | float | str):
        node = {**node, "default": field.default}
    return node


def _value(kind: Any, marks: Iterable[Any], definitions: dict[str, _Node]) -> _Node:
    """Anything that stands behind a key."""
    marks = list(_flat(marks))
    for mark in marks:
        if isinstance(mark, Chosen) and isinstance(mark.function, ByName):
            one = _value(mark.function.kind, (), definitions)
            return _any_of([one, {"type": "object", "additionalProperties": one, "minProperties": 1}])
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _value(parts[0], [*parts[1:], *marks], definitions)
    if origin in (Union, UnionType):
        allowed = [part for part in parts if part not in (NoneType, Python)]
        return _any_of([_value(part, marks, definitions) for part in allowed])
    if origin is Literal:
        return {"enum": list(parts)}
    if origin is tuple:
        few = {"minItems": 1} if AfterValidator(not_empty) in marks else {}
        return {"type": "array", "items": _value(parts[0], (), definitions), **few}
    if origin is dict:
        return {"type": "object", "additionalProperties": _value(parts[1], (), definitions)}
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return _reference(kind, definitions)
    return _scalar(kind, marks)


def _scalar(kind: Any, marks: list[Any]) -> _Node:
    """A number, with its limits; where it measures something also a text with a unit."""
    node: _Node = {"type": _PLAIN[kind]}
    for mark in marks:
        if type(mark) in _LIMITS:
            keyword, name = _LIMITS[type(mark)]
            node[keyword] = getattr(mark, name)
    dimensions = [mark.dimension for mark in marks if isinstance(mark, Measured)]
    if dimensions:
        example = f'such as "{dimensions[-1].example}", where the scenario has [scales]'
        return {"anyOf": [node, {"type": "string", "description": example}]}
    return node


def _reference(model: type[BaseModel], definitions: dict[str, _Node]) -> _Node:
    name = model.__name__
    if name not in definitions:
        model.model_rebuild()  # names that are defined after it
        definitions[name] = {}  # a cycle has steps, which may be cycles
        definitions[name] = _table(model, definitions)
        if model in (Preset, MaxwellPreset):
            known = [key for key, one in PRESETS.items() if model is Preset or one.branches]
            definitions[name]["properties"]["preset"]["enum"] = sorted(known)
    return {"$ref": f"#/definitions/{name}"}


def _any_of(nodes: list[_Node]) -> _Node:
    return nodes[0] if len(nodes) == 1 else {"anyOf": nodes}


def _flat(marks: Iterable[Any]) -> Iterator[Any]:
    """The marks of an annotation, those of its fields among them."""
    for mark in marks:
        yield from _flat(mark.metadata) if isinstance(mark, FieldInfo) else (mark,)
