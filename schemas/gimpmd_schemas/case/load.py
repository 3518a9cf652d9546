"""Reading and writing case files: strict types, every problem at once, "did you mean"."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec
import yaml

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.on_disk import write_at_once


class _Loader(yaml.SafeLoader):
    """YAML 1.1 as PyYAML reads it, but 1e-3 is a number and a key given twice is an error."""


class _Dumper(yaml.SafeDumper):
    """Quotes what the loader would take for a number."""


for _kind in (_Loader, _Dumper):
    _kind.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
        list("-+.0123456789"),
    )


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[str] = set()
    for key_node, _ in node.value:
        if key_node.id != "scalar":
            raise yaml.constructor.ConstructorError(
                None, None, "a key must be a single word", key_node.start_mark
            )
        if key_node.value in seen:
            raise yaml.constructor.ConstructorError(
                None, None, f"key {key_node.value!r} appears twice", key_node.start_mark
            )
        seen.add(key_node.value)
    return loader.construct_mapping(node, deep=True)


def _small(number: int) -> int:
    """The number; raises `ValueError` if it has more than 63 bits."""
    if not -(2**63) <= number < 2**63:
        raise ValueError("a whole number has more than 63 bits")
    return number


def _integer(loader: _Loader, node: yaml.ScalarNode) -> int:
    number = loader.construct_yaml_int(node)
    try:
        return _small(int(number))
    except ValueError as error:
        raise yaml.constructor.ConstructorError(None, None, str(error), node.start_mark) from None


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)
_Loader.add_constructor("tag:yaml.org,2002:int", _integer)

# What PyYAML lets slip from the constructors of its tags (`!!bool 5`, `2020-99-99`), and what
# too many open brackets end in.
_SLIPS = (ValueError, TypeError, LookupError, AttributeError, RecursionError)


_MOST_BYTES = 500_000
"""Size of a file that is read as YAML: PyYAML takes some ten seconds for as much."""

_MOST_JSON = 200_000_000
"""Size of a file that is read as JSON: what gimpmd has measured for a large case has megabytes."""


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Mapping of JSON; raises `ValueError` if a key is given twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key appears twice")
    return found


def parse_yaml(path: Path) -> object:
    """Read a YAML file. One that is JSON, as every such file is YAML, is read much faster.

    Raises
    ------
    InputError
        The file cannot be read, is too large, or is not YAML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
            if data.startswith(b"{"):
                data += file.read(_MOST_JSON)
                try:
                    return json.loads(
                        data,
                        object_pairs_hook=_unique,
                        parse_int=lambda digits: _small(int(digits)),
                    )
                except (ValueError, RecursionError):
                    pass  # YAML with brackets, or with a mistake that the YAML reader names
        if len(data) > _MOST_BYTES:
            message = f"is larger than {_MOST_BYTES // 1000} kB, so it cannot be a case"
            hint = "check the path; a case of a few hundred lines has 20 kB"
            raise InputError(str(path), [Problem("file", None, message, hint)])
        text = data.decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            str(path), [Problem("file", None, f"cannot be read: {reason}", "check the path")]
        ) from None
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, *_SLIPS) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        what = getattr(error, "problem", None) or str(error)
        raise InputError(
            str(path),
            [
                Problem(
                    "yaml",
                    None,
                    f"not valid YAML{where}: {what}",
                    "check indentation, brackets and quotes there",
                )
            ],
        ) from None


_WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    bytes: "text in base64",
    type(None): "null",
}


def _words(annotation: Any, dims: tuple[int, ...] = (2, 3)) -> str:
    """Describe what a value of this type looks like in a case file of a number of dimensions."""
    items = get_args(annotation)
    if get_origin(annotation) is Annotated:  # a tuple with an entry for each axis
        (entry, _) = get_args(items[0])
        return " or ".join(
            f"[{', '.join([_words(entry, (n,)).removeprefix('a ')] * n)}]" for n in dims
        )
    if annotation in _WORDS:
        return _WORDS[annotation]
    if get_origin(annotation) is Literal:
        return ("one of " if len(items) > 1 else "") + ", ".join(repr(item) for item in items)
    if get_origin(annotation) is dict:
        return "keys with values"
    if get_origin(annotation) is tuple and items[-1] is ...:
        return "a list" if _structs(items[0]) else f"a list, each {_words(items[0])}"
    if get_origin(annotation) is tuple:
        return f"[{', '.join(_words(item).removeprefix('a ') for item in items)}]"
    if structs := _structs(annotation):
        others = [_words(o, dims) for o in _options(annotation) if o not in (*structs, type(None))]
        keys = "keys with values: " + " or ".join(", ".join(_known(s)) for s in structs)
        return " or ".join([*others, keys])
    return " or ".join(_words(item) for item in items)


def _structs(annotation: Any) -> list[type[msgspec.Struct]]:
    """Structs that a value may be: the annotation itself, or the members of its union."""
    options = _options(annotation)
    return [o for o in options if isinstance(o, type) and issubclass(o, msgspec.Struct)]


def _options(annotation: Any) -> tuple[Any, ...]:
    """Members of a union; of anything else, itself."""
    union = get_origin(annotation) in (Union, UnionType)
    return get_args(annotation) if union else (annotation,)


@cache
def _fields(struct: type[msgspec.Struct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    """Fields of a struct; msgspec finds their types anew in every call."""
    return msgspec.structs.fields(struct)


def _known(struct: type[msgspec.Struct]) -> list[str]:
    """Keys of a struct, the one that tells it from others first."""
    tag = struct.__struct_config__.tag_field
    return ([tag] if tag else []) + [field.encode_name for field in _fields(struct)]


def _did_you_mean(word: object, known: Iterable[object]) -> str:
    texts = [text for text in known if isinstance(text, str)]
    close = difflib.get_close_matches(str(word).lower(), texts, n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}?" if close else ""


def _way_out(annotation: Any, value: object) -> str:
    """Advice for a value of the wrong type."""
    options = (annotation, *get_args(annotation))
    literals = [literal for option in options for literal in get_args(option)]
    if hint := isinstance(value, str) and _did_you_mean(value, literals):
        return hint
    if isinstance(value, str) and re.fullmatch(r"[-+.\deE]+", value) and {int, float} & {*options}:
        return "write it without quotes"
    if isinstance(value, float) and value.is_integer() and int in options:
        return f"write {int(value)}"
    if value is None:
        return "give it a value, or leave the key out if it has a default"
    if str in options and not isinstance(value, (str, list, dict)):
        return "put it in quotes"
    return "docs/case.md describes every key"


def _check(annotation: Any, value: object, key: str, problems: list[Problem]) -> None:
    """Collect what is wrong with ``value``, descending into structs and lists of structs."""
    lists = [o for o in _options(annotation) if get_origin(o) is tuple and _structs(get_args(o)[0])]
    if isinstance(value, list) and lists:
        for index, item in enumerate(value):
            _check(get_args(lists[0])[0], item, f"{key}[{index}]", problems)
        return
    if isinstance(value, dict) and (structs := _structs(annotation)):
        struct = structs[0] if len(structs) == 1 else _choose(structs, value, key, problems)
        if struct is not None:
            _check_struct(struct, value, key, problems)
        return
    try:
        msgspec.convert(value, annotation, strict=True)
    except msgspec.ValidationError:
        problems.append(
            Problem(key, value, f"must be {_words(annotation)}", _way_out(annotation, value))
        )
        return
    if not _printable(value):
        problems.append(
            Problem(key, value, "holds characters that cannot be printed", "retype the text")
        )


def _printable(value: object) -> bool:
    """Whether all text in a plain value can be written to files, logs and LAMMPS scripts."""
    if isinstance(value, dict):
        return all(_printable(item) for pair in value.items() for item in pair)
    if isinstance(value, list):
        return all(_printable(item) for item in value)
    return not isinstance(value, str) or value.isprintable()


def _choose(
    structs: list[type[msgspec.Struct]], value: dict[Any, Any], key: str, problems: list[Problem]
) -> type[msgspec.Struct] | None:
    """Member of a tagged union that a mapping is meant to be, by its tag."""
    field = structs[0].__struct_config__.tag_field
    tags = {struct.__struct_config__.tag: struct for struct in structs}
    tag = value.get(field)
    if isinstance(tag, str) and tag in tags:
        return tags[tag]
    choices = " or ".join(
        f"{field}: {tag} (with {', '.join(_known(struct)[1:])})" for tag, struct in tags.items()
    )
    hint = _did_you_mean(tag, tags) if tag is not None else ""
    message = "missing" if field not in value else f"must be one of {', '.join(map(repr, tags))}"
    problems.append(Problem(f"{key}.{field}", tag, message, hint or f"write {choices}"))
    return None


def _check_struct(
    struct: type[msgspec.Struct], value: dict[Any, Any], key: str, problems: list[Problem]
) -> None:
    prefix = f"{key}." if key else ""
    known = _known(struct)
    for name, item in value.items():
        if name not in known:
            hint = _did_you_mean(name, known) or f"known keys: {', '.join(known)}"
            problems.append(Problem(f"{prefix}{name}", item, "unknown key", hint))
    for field in _fields(struct):
        name = field.encode_name
        if name in value:
            _check(field.type, value[name], f"{prefix}{name}", problems)
        elif field.required:
            problems.append(
                Problem(f"{prefix}{name}", None, "missing", f"it must be {_words(field.type)}")
            )


def load_case(path: Path) -> Case:
    """Read a case file and check its form; what it means is checked by ``checks.check_case``.

    Raises
    ------
    InputError
        With every problem of form in the file: unknown keys, wrong types, missing keys.
    """
    raw = parse_yaml(path)
    problems: list[Problem] = []
    if not isinstance(raw, dict):
        what = "is empty" if raw is None else "holds no keys"
        raise InputError(str(path), [Problem("file", None, what, "docs/case.md shows a case")])
    _check_struct(Case, raw, "", problems)
    if problems:
        raise InputError(str(path), problems)
    return msgspec.convert(raw, Case, strict=True)


def dump_json(case: Case, path: Path) -> None:
    """Write a case as JSON, for a program: it is YAML too, and `load_case` reads it much faster."""
    write_at_once(path, json.dumps(msgspec.to_builtins(case, str_keys=True)).encode())


def dump_case(case: Case, path: Path) -> None:
    """Write a case as YAML; reading it back gives an equal case."""
    data = msgspec.to_builtins(case, str_keys=True)
    text = yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None
    )
    write_at_once(path, text.encode())
