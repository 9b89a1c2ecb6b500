"""``docs/result.schema.json`` is what ``result.json`` looks like."""

import json
from pathlib import Path
from typing import get_args

import pytest

from fauna.reconstruct.report import SCHEMA, report
from fauna.reconstruct.status import FLAGS, MEANINGS, Status

SCHEMA_FILE = Path(__file__).parents[2] / "docs" / "result.schema.json"
TYPES = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "null": type(None)}


def check(value, schema, path="result"):
    """The part of JSON Schema that the file uses."""
    if "const" in schema:
        assert value == schema["const"], path
    if "enum" in schema:
        assert value in schema["enum"], path
    if "type" in schema:
        names = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
        assert any(isinstance(value, TYPES[name]) for name in names), f"{path}: {value!r} is no {names}"
        assert not isinstance(value, bool) or "boolean" in names, path
    if isinstance(value, (int, float)):
        assert schema.get("minimum", value) <= value <= schema.get("maximum", value), path
    for index, item in enumerate(value if isinstance(value, list) else ()):
        check(item, schema.get("items", {}), f"{path}[{index}]")
    if isinstance(value, dict):
        known, more = schema.get("properties", {}), schema.get("additionalProperties", {})
        assert set(schema.get("required", ())) <= set(value), path
        for key, item in value.items():
            assert key in known or more is not False, f"{path}.{key} is not in the schema"
            check(item, known.get(key, more or {}), f"{path}.{key}")


@pytest.fixture(scope="module")
def schema():
    return json.loads(SCHEMA_FILE.read_text(encoding="utf-8"))


def test_results_with_and_without_an_animal_follow_the_schema(loaded, drawn, stand_ins, schema):
    for mask in (drawn[1], drawn[1] & False):
        result = loaded.reconstruct(drawn[0], mask=mask)
        content = json.loads(json.dumps(report(result, seconds=result.seconds, files=["result.json"])))
        check(content, schema)
        assert set(content) | {"key", "animals", "application"} == set(schema["properties"])
        with pytest.raises(AssertionError):
            check({**content, "confidence": 2.0}, schema)
        with pytest.raises(AssertionError):
            check({**content, "surprise": 1}, schema)


def test_every_status_and_flag_has_a_meaning(schema):
    assert list(MEANINGS) == list(get_args(Status)) == schema["properties"]["status"]["enum"]
    assert schema["properties"]["schema"]["const"] == SCHEMA
    text = (SCHEMA_FILE.parent / "reconstruct.md").read_text(encoding="utf-8")
    for word in (*MEANINGS, *FLAGS):
        assert f"`{word}`" in text, word
