"""Writes the JSON Schemas of the contract: ``python -m gimpmd_schemas.schema_files``."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path
from typing import Any

import msgspec

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.wire.messages import Header

FOLDER = Path(__file__).resolve().parents[1]
DRAFT = "https://json-schema.org/draft/2020-12/schema"

_ATTRIBUTES = re.compile(r"\s*(?:Attributes|Parameters)\s*\n\s*-+\n")
_ATTRIBUTE = re.compile(r"^(\w+(?:, \w+)*) : ((?:.+\n?)(?:^ +.*\n?)*)", re.MULTILINE)


def render() -> dict[str, str]:
    """Text of every schema file by its name."""
    return {
        "case.schema.json": _text("gimpmd case file", Case),
        "plan.schema.json": _text("plan of a gimpmd run", Plan),
        "messages.schema.json": _text("header of a gimpmd frame", Header),
    }


def _text(title: str, root: type[msgspec.Struct]) -> str:
    schema = {"$schema": DRAFT, "title": title, **msgspec.json.schema(root)}
    for definition in schema["$defs"].values():
        _describe(definition)
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _describe(definition: dict[str, Any]) -> None:
    """Move what a docstring says of the attributes to the properties themselves."""
    about, *attributes = _ATTRIBUTES.split(inspect.cleandoc(definition.get("description", "")))
    definition["description"] = _one_line(about)
    for names, text in _ATTRIBUTE.findall("".join(attributes)):
        for name in names.split(", "):
            definition["properties"][name]["description"] = _one_line(text)


def _one_line(text: str) -> str:
    return " ".join(text.replace("``", "`").split())


def main() -> None:
    """Write the files beside the package."""
    for name, text in render().items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
