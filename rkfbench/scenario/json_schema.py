"""The JSON Schemas of scenario and paper files, for editors: the schema of the keys, with the catalogues written in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rkfbench import metrics
from rkfbench.catalogue import Catalogue, Entry, parameter_model
from rkfbench.filters import FILTERS
from rkfbench.scenario.attached import SIMULATED
from rkfbench.scenario.defaults import KINDS, PARTS
from rkfbench.scenario.files import FOLDER
from rkfbench.scenario.filters import Head
from rkfbench.scenario.paper_schema import Paper
from rkfbench.scenario.schema import ScenarioFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]
PLUGIN: Schema = {"type": "string", "pattern": "^[^:]+:[A-Za-z_]\\w*$", "description": "module:name or file.py:name"}


def schema() -> Schema:
    """The schema of a scenario file, with every model, law, filter and metric of the catalogues."""
    whole: Schema = {"$schema": DIALECT} | _any(ScenarioFile.model_json_schema()) | {"title": "rkfbench scenario"}
    definitions, properties = whole["$defs"], whole["properties"]
    whole["anyOf"] = [{"required": ["data"]}, {"required": list(SIMULATED)}]
    for name, key in {
        "Model": "model",
        "Truth": "truth",
        "Law": "process_noise",
        "Disturbance": "disturbances",
    }.items():
        extra = {"label": {"type": "string"}} if name == "Disturbance" else {}
        forms = [_kind(each, entry, extra) for each, entry in KINDS[key].items()]
        definitions[name] = {"anyOf": forms + ([_plugin("kind")] if isinstance(KINDS[key], Catalogue) else [])}
    properties["model"] |= {"$ref": "#/$defs/Model"}
    properties["measurement_noise"] |= {"$ref": "#/$defs/Law"}
    properties["process_noise"] |= {"anyOf": [{"$ref": "#/$defs/Law"}, {"type": "null"}]}
    properties["truth"] |= {"anyOf": [{"const": "model"}, {"$ref": "#/$defs/Truth"}]}
    properties["disturbances"]["items"] = {"$ref": "#/$defs/Disturbance"}
    properties["metrics"]["items"] = {
        "type": "string",
        "pattern": f"^({'|'.join(metrics.METRICS)}|[^:]+:\\w+)([(\\[@].*)?$",
    }
    head = Head.model_json_schema()
    definitions |= head.get("$defs", {})
    properties["filters"]["items"] = _filter(head["properties"])
    return whole


def paper_schema() -> Schema:
    """The schema of a paper's file."""
    return {"$schema": DIALECT} | _any(Paper.model_json_schema()) | {"title": "rkfbench paper"}


def texts() -> dict[str, str]:
    """What the committed schema files should hold, by path within `scenarios/`."""
    current = {"scenario.schema.json": schema(), "papers/paper.schema.json": paper_schema()}
    return {name: json.dumps(each, indent=1, ensure_ascii=False) + "\n" for name, each in current.items()}


def write(folder: Path = FOLDER) -> None:
    """Write the schema files anew."""
    for name, text in texts().items():
        (folder / name).write_text(text, encoding="utf-8")


def _object(properties: Schema, required: list[str], description: str = "") -> Schema:
    described = {"description": description} if description else {}
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
        **described,
    }


def _kind(name: str, entry: Entry, extra: Schema) -> Schema:
    """`{kind: name, parameters}`."""
    own = parameter_model(entry.make).model_json_schema()
    properties = {"kind": {"const": name}} | own["properties"] | extra
    return _object(properties, ["kind", *own.get("required", [])], entry.summary)


def _plugin(key: str) -> Schema:
    """A mapping in which a plug-in stands for a name; what else it may hold, its own signature says."""
    return _object({key: PLUGIN}, [key], "A plug-in.") | {"additionalProperties": True}


def _filter(head: Schema) -> Schema:
    """A name, `{use: name, parameters}`, `{moments:, weight:, update:}`, or a filter around another one."""
    forms = [{"enum": list(FILTERS)}, PLUGIN, _plugin("use")]
    for name, entry in FILTERS.items():
        own = parameter_model(entry.make).model_json_schema()
        listed = {key: _or_list(value) for key, value in own["properties"].items()}
        required = own.get("required", [])
        forms.append(_object({"use": {"const": name}} | listed | head, ["use", *required], entry.summary))
        if "filter" in listed:
            forms.append(_object({name: _object(listed, required)} | head, [name, "label"], entry.summary))
    parts = {part: _part(catalogue) for part, catalogue in PARTS.items()}
    forms.append(_object(parts | head, ["label"], "A filter made of parts."))
    return {"anyOf": forms}


def _part(catalogue: Mapping[str, Entry]) -> Schema:
    """`name` or `{name: {parameters}}`."""
    forms: list[Schema] = [{"enum": list(catalogue)}]
    if isinstance(catalogue, Catalogue):
        forms += [PLUGIN, _object({}, [], "A plug-in.") | {"propertyNames": PLUGIN, "additionalProperties": True}]
    for name, entry in catalogue.items():
        own = parameter_model(entry.make).model_json_schema()
        listed = {key: _or_list(value) for key, value in own["properties"].items()}
        forms.append(_object({name: _object(listed, own.get("required", []))}, [name], entry.summary))
    return {"anyOf": forms}


def _or_list(value: Schema) -> Schema:
    """A scalar parameter may list values: each makes a filter."""
    if value.get("type") == "array":
        return value
    return {"anyOf": [value, {"type": "array", "items": value, "minItems": 1}]}


def _any(schema: Any) -> Any:
    """The schema with anyOf for oneOf: forms of a key may overlap ({values: ...} is a mapping like any other)."""
    if isinstance(schema, dict):
        return {"anyOf" if key == "oneOf" else key: _any(value) for key, value in schema.items()}
    return [_any(each) for each in schema] if isinstance(schema, list) else schema
