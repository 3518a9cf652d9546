"""The JSON Schemas: up to date, and of one mind with the loaders."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import numpy as np
import pytest
import yaml

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.schema_files import FOLDER, render
from gimpmd_schemas.wire.messages import Payload, encode

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(ROOT.glob("examples/*/case.yaml"))


def validator(name: str) -> jsonschema.Draft202012Validator:
    """Validator of a schema on disk."""
    schema = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", list(render()))
def test_files_are_up_to_date(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == render()[name], (
        "run python -m gimpmd_schemas.schema_files"
    )


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_examples_obey_the_schema(path: Path) -> None:
    raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert list(validator("case.schema.json").iter_errors(raw)) == []


def test_there_are_examples() -> None:
    assert EXAMPLES


@pytest.mark.parametrize(
    "changes",
    [
        {"units": "ev"},
        {"grid__cel": 4},
        {"grid": ...},
        {"continuum__material": {"from": "cas"}},
        {"domain__box": [[0, 1]]},
    ],
)
def test_the_schema_refuses_what_the_loader_refuses(
    plain: Callable[..., dict[str, Any]], changes: dict[str, Any]
) -> None:
    raw = plain(**changes)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(raw, Case)
    assert not validator("case.schema.json").is_valid(raw)
    assert validator("case.schema.json").is_valid(plain())


def test_headers_on_the_wire_obey_the_schema() -> None:
    frame = encode(Payload(role="md", rank=1, step=3), {"velocity": np.zeros((4, 2))})
    length = int.from_bytes(frame[8:12], "little")
    header = json.loads(frame[12 : 12 + length])
    assert list(validator("messages.schema.json").iter_errors(header)) == []


def test_descriptions_come_from_the_docstrings() -> None:
    schema = json.loads((FOLDER / "case.schema.json").read_text(encoding="utf-8"))
    steps = schema["$defs"]["Time"]["properties"]["md_steps"]
    assert "the MD steps per continuum step" in steps["description"]
    for name, definition in schema["$defs"].items():
        assert definition["description"], name
        assert "----" not in definition["description"], name
