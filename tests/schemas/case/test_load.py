"""Case files: every problem of form is reported with key, value and a way out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gimpmd_schemas.case.form import FACES, Case, Planes, Sites
from gimpmd_schemas.case.load import dump_case, dump_json, load_case
from gimpmd_schemas.errors import InputError, Problem

Plain = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A path that every test may write to."""
    return tmp_path_factory.mktemp("case") / "case.yaml"


def problems(file: Path, raw: object) -> list[Problem]:
    """Problems in a case file of these values, or of this text."""
    file.write_text(raw if isinstance(raw, str) else yaml.safe_dump(raw), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_case(file)
    assert str(file) in str(caught.value)
    return caught.value.problems


def the_problem(file: Path, raw: object) -> Problem:
    """The one problem there is."""
    (problem,) = problems(file, raw)
    return problem


def per_axis(entry: str) -> str:
    """Words for one entry per axis."""
    return f"[{entry}, {entry}] or [{entry}, {entry}, {entry}]"


def leaves(struct: type[msgspec.Struct], prefix: str = "") -> Iterator[tuple[str, Any, bool]]:
    """Every field of the case format with its dotted key, type, and whether a struct's list."""
    for field in msgspec.structs.fields(struct):
        key = prefix + field.encode_name
        annotation: Any = field.type
        items = get_args(annotation)
        structs = [
            o for o in (annotation, *items) if isinstance(o, type) and issubclass(o, msgspec.Struct)
        ]
        yield key, annotation, bool(structs)
        if get_origin(annotation) is not tuple:
            for inner in structs:
                yield from leaves(inner, f"{key}.")


KEYS = sorted({key for key, _, _ in leaves(Case)})


def put(raw: dict[str, Any], key: str, value: object) -> dict[str, Any]:
    """Set a dotted key; what the key is part of is there and complete."""
    *parents, last = key.split(".")
    if key == "continuum.material.cell":
        raw["continuum"]["material"] = {"from": "md", "cell": "cell.in"}
    if key.startswith("continuum.body_force."):
        raw["continuum"]["body_force"] = {"acceleration": [0.0, 1.0]}
    if key.startswith("coupling.crystal."):
        raw.setdefault("coupling", {})["crystal"] = {
            "vectors": [[1.0, 0.0], [0.5, 0.8]],
            "origin": [0.0, 0.0],
            "bonds": [[1.0, 0.0]],
            "energy": [[0.0, 1.0]],
            "stretch_limit": 0.1,
        }
    if key.startswith("coupling.sites."):
        raw.setdefault("coupling", {})["sites"] = {
            "vectors": [[1.0, 0.0], [0.5, 0.85]],
            "origin": [0.0, 0.0],
            "basis": [[0.0, 0.0]],
            "shift": "AAAAAAAAAAA=",
            "period": [1.0, 1.7],
            "layers": [0.5, 0.85],
            "second": [{"left": 3.0}],
            "nodes": [7],
            "force": "AAAAAAAA8D8=",
            "stress": "AAAAAAAA8D8=",
        }
    if key.startswith("coupling.absorber."):
        raw.setdefault("coupling", {})["absorber"] = {"rate": 1.0}
    if key.startswith("initial.stretch."):
        raw.setdefault("initial", {})["stretch"] = {"gradient": [[0.001, 0.0], [0.0, 0.0]]}
    if parents[-1:] == ["value"]:
        k_field = {"profile": "k-field", "tip": [0.0, 0.0], "k1": 1.0}
        linear = {"profile": "linear", "value": [1.0, 0.0], "gradient": [[1.0, 0.0], [0.0, 1.0]]}
        value_of_face = k_field if last in ("tip", "k1", "k2", "angle") else linear
        raw.setdefault("boundary", {})[parents[1]] = {"value": value_of_face}
    place = raw
    for parent in parents:
        place = place.setdefault(parent, {})
    place[last] = value
    return raw


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("value", [[[[]]], {"x": [1]}], ids=["list", "mapping"])
def test_wrong_type_of_every_key_is_reported(
    file: Path, plain: Plain, key: str, value: object
) -> None:
    found = problems(file, put(plain(), key, value))
    assert all(p.key.startswith(key) for p in found), [str(p) for p in found]
    assert all(p.message and p.hint for p in found), [str(p) for p in found]


@pytest.mark.parametrize("key", KEYS)
def test_empty_value_of_every_key_is_reported_or_means_none(
    file: Path, plain: Plain, key: str
) -> None:
    raw = put(plain(), key, None)
    file.write_text(yaml.safe_dump(raw))
    nullable = {"md", "md.region", "md.after", "md.cutoff", "time.md_timestep", "only"}
    nullable |= {"checkpoint", "checkpoint.steps"}
    nullable |= {"continuum.body_force", "coupling.filter_rate", "coupling.crystal"}
    nullable |= {"coupling.planes", "coupling.absorber"}
    nullable |= {"coupling.absorber.rate", "coupling.absorber.width"}
    nullable |= {"coupling.sites"}
    nullable |= {"initial.stretch", "initial.stretch.center", "continuum.temperature"}
    nullable |= {"continuum.mesh"}
    nullable |= {"output.energy_interval"} | {f"boundary.{face}.stiffness" for face in FACES}
    nullable |= {f"boundary.{face}.value.center" for face in FACES}
    if key in nullable or key.startswith(("coupling.zones.", "coupling.planes.")):
        load_case(file)
    else:
        problem = the_problem(file, raw)
        assert problem.key == key
        assert problem.hint


@pytest.mark.parametrize(
    ("key", "value", "message", "hint"),
    [
        ("grid.cell", "4", "must be a number", "write it without quotes"),
        ("grid.cell", True, "must be a number", "docs/case.md"),
        ("md.ranks", 2.0, "must be a whole number", "write 2"),
        ("md.ranks", "two", "must be a whole number", "docs/case.md"),
        ("time.md_steps", "aut", "must be a whole number or 'auto'", "did you mean 'auto'?"),
        ("time.md_steps", 40.0, "must be a whole number or 'auto'", "write 40"),
        ("time.md_steps", 40.5, "must be a whole number or 'auto'", "docs/case.md"),
        ("units", "LJ", "must be one of 'lj', 'metal', 'real', 'si'", "did you mean 'lj'?"),
        ("units", "ev", "must be one of 'lj', 'metal', 'real', 'si'", ""),
        ("gimpmd", 2, "must be 1", ""),
        ("name", 5, "must be text", "put it in quotes"),
        ("domain.box", [[0, 1]], f"must be {per_axis('[number, number]')}", ""),
        ("domain.box", [[0, "a"], [0, 1]], f"must be {per_axis('[number, number]')}", ""),
        ("domain.periodic", [1, 0], f"must be {per_axis('true or false')}", ""),
        ("continuum.body_force.acceleration", 9.8, f"must be {per_axis('number')}", ""),
        ("md.patches", [1], f"must be {per_axis('whole number')} or 'auto'", ""),
        ("md.files", ["a", 1], "must be a list, each text", ""),
        ("md.variables", {"a": [1]}, "must be keys with values", ""),
        ("md.after", 1, "must be text or null", "put it in quotes"),
        ("grid", [4], "must be keys with values: cell, points_per_axis, levels", ""),
        (
            "output",
            None,
            "must be keys with values: interval, energy_interval, nodes, figures",
            "leave the key out",
        ),
        ("continuum.cracks", {"from": [0, 0]}, "must be a list", ""),
        (
            "boundary.top",
            {"value": 0.3},
            f"must be {per_axis('number or null')} or keys with values: profile, value, gradient, "
            "center or profile, tip, k1, k2, angle",
            "",
        ),
        ("name", "a\nb", "holds characters that cannot be printed", "retype"),
    ],
)
def test_messages(
    file: Path, plain: Plain, key: str, value: object, message: str, hint: str
) -> None:
    problem = the_problem(file, put(plain(), key, value))
    assert problem.key.startswith(key)
    assert problem.message == message
    assert hint in problem.hint
    assert problem.hint


MATRIX = "must be a list, each a list, each a number"
TAGS = "must be one of 'moduli', 'stiffness', 'hyperelastic', 'lattice', 'embedded', 'j2', 'md'"


@pytest.mark.parametrize(
    ("material", "key", "message", "hint"),
    [
        (
            {"density": 1},
            ".from",
            "missing",
            "from: moduli (with density, lame, shear, model, plane) or from: stiffness (with",
        ),
        ({"from": "modul"}, ".from", TAGS, "did you mean 'moduli'?"),
        ({"from": "lammps"}, ".from", TAGS, "from: md (with cell, model, degree, strain_limit)"),
        ({"from": ["md"]}, ".from", TAGS, "from: md (with cell, model, degree, strain_limit)"),
        ({"from": "md"}, ".cell", "missing", "it must be text"),
        ({"from": "stiffness", "density": 1, "stiffness": 3}, ".stiffness", MATRIX, ""),
        (
            [1],
            "",
            "must be keys with values: from, density, lame, shear, model, plane or from, density, "
            "stiffness, thermal_stress or from, density, coefficients, strain_limit, lame, shear, "
            "thermal_stress or from, density, lame, shear, area, bonds, energy, stretch_limit or "
            "from, density, stiffness, volume, bonds, cutoff, distance_step, density_step, pair, "
            "cloud, embedding, thermal_stress or from, density, lame, shear, yield_stress, "
            "hardening or from, cell, model, degree, strain_limit",
            "",
        ),
    ],
)
def test_material(
    file: Path, plain: Plain, material: object, key: str, message: str, hint: str
) -> None:
    problem = the_problem(file, plain(continuum__material=material))
    assert (problem.key, problem.message) == (f"continuum.material{key}", message)
    assert hint in problem.hint
    assert problem.hint


def test_keys_of_the_other_material_are_unknown(file: Path, plain: Plain) -> None:
    raw = plain(continuum__material={"from": "md", "cell": "c.in", "lame": 1.0})
    problem = the_problem(file, raw)
    assert problem.key == "continuum.material.lame"
    assert problem.hint == "known keys: from, cell, model, degree, strain_limit"


def test_items_of_lists_are_named(file: Path, plain: Plain) -> None:
    raw = plain(initial__packets=[{"center": 1, "wavelength": 2, "strain": 3}, {"centre": 1}, 7])
    found = {p.key: p for p in problems(file, raw)}
    assert set(found) == {
        "initial.packets[1].centre",
        "initial.packets[1].center",
        "initial.packets[1].wavelength",
        "initial.packets[1].strain",
        "initial.packets[2]",
    }
    assert found["initial.packets[1].centre"].hint == "did you mean 'center'?"


def test_all_problems_are_told_at_once(file: Path, plain: Plain) -> None:
    raw = plain(units="ev", grid={"cel": 4}, time__end="x", md__region=[1], output=..., colour=1)
    found = {p.key: p for p in problems(file, raw)}
    assert set(found) == {
        "units", "grid.cel", "grid.cell", "time.end", "md.region", "output", "colour",
    }  # fmt: skip
    assert found["grid.cel"].hint == "did you mean 'cell'?"
    assert found["grid.cell"].message == "missing"
    assert "known keys: gimpmd, name" in found["colour"].hint


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 1e-3), ("1E5", 1e5), ("-2.5e+3", -2500.0), (".5e1", 5.0), ("4", 4.0), ("4.", 4.0)],
)
def test_numbers(file: Path, plain: Plain, text: str, value: float) -> None:
    raw = yaml.safe_dump(plain(grid__cell="CELL")).replace("CELL", text)
    file.write_text(raw)
    assert load_case(file).grid.cell == value


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("- 1\n- 2\n", "holds no keys"),
        ("a: 1\na: 2\n", "key 'a' appears twice"),
        ("grid: {cell: 4, cell: 5}", "key 'cell' appears twice"),
        ("[1]: 2", "a key must be a single word"),
        ("{a: b}: 2", "a key must be a single word"),
        ("a: [1, 2", "line 1, column 9"),
        ("a: !!bool 5", "not valid YAML"),
        ("a: 2020-99-99", "not valid YAML"),
        ("a: !!timestamp x", "not valid YAML"),
        ("a: !!python/object:os.system {}", "could not determine a constructor"),
        ("&a [*a]: 1", "a key must be a single word"),
        ("a: &b {c: *b}", "recursive"),
        ("a: " + "[" * 5000, "not valid YAML"),
        ("a: " + "9" * 30, "more than 63 bits"),
        ("a: " + "9" * 5000, "not valid YAML"),
        ("a: 0x" + "f" * 5000, "more than 63 bits"),
        ("a: \0", "not valid YAML"),
    ],
)
def test_files_that_are_no_case(file: Path, text: str, said: str) -> None:
    assert said in the_problem(file, text).message


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    for path, said in ((tmp_path, "directory"), (tmp_path / "absent", "No such file")):
        with pytest.raises(InputError, match=said):
            load_case(path)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="utf-8"):
        load_case(tmp_path / "binary")


def test_long_values_are_shortened(file: Path, plain: Plain) -> None:
    bomb = "a: &a [1, 1]\n" + "".join(
        f"{b}: &{b} [*{a}, *{a}, *{a}, *{a}, *{a}, *{a}, *{a}, *{a}]\n"
        for a, b in zip("abcdefghijk", "bcdefghijkl", strict=True)
    )
    file.write_text(bomb)
    with pytest.raises(InputError) as caught:
        load_case(file)
    assert len(str(caught.value)) < 100_000


def test_merge_keys_work(file: Path, plain: Plain) -> None:
    raw = plain(boundary={"top": "TOP", "bottom": "BOTTOM"})
    text = yaml.safe_dump(raw)
    text = text.replace("BOTTOM", "&load {condition: traction, value: [0, -0.3], ramp: 10}")
    file.write_text(text.replace("TOP", "{<<: *load, value: [0, 0.3]}"))
    assert load_case(file).boundary.top == msgspec.structs.replace(
        load_case(file).boundary.bottom, value=(0.0, 0.3)
    )


number = st.floats(allow_nan=False, allow_infinity=False)
word = st.text(st.characters(categories=["L", "N", "P", "S"]), max_size=12)
whole = st.integers(-(2**63), 2**63 - 1)
leaf = {
    float: number,
    int: whole,
    str: word,
    dict[str, float | str]: st.dictionaries(word, number | word, max_size=3),
}


def sound(annotation: Any) -> st.SearchStrategy[Any]:
    """Values of a type of the case format."""
    if annotation in leaf:
        return leaf[annotation]
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return st.builds(
            annotation, **{f.name: sound(f.type) for f in msgspec.structs.fields(annotation)}
        )
    if get_origin(annotation) is tuple and get_args(annotation)[-1] is ...:
        return st.lists(sound(get_args(annotation)[0]), max_size=2).map(tuple)
    if get_origin(annotation) is tuple:
        return st.tuples(*map(sound, get_args(annotation)))
    if get_origin(annotation) is Annotated:
        entries, meta = get_args(annotation)
        item = sound(get_args(entries)[0])
        return st.lists(item, min_size=meta.min_length or 0, max_size=meta.max_length).map(tuple)
    if get_origin(annotation) is Literal:
        return st.sampled_from(get_args(annotation))
    if options := get_args(annotation):
        return st.one_of(*map(sound, options))
    return st.from_type(annotation)


@settings(max_examples=30)  # each draws a whole case
@given(case=sound(Case))
def test_dump_and_load(file: Path, case: Case) -> None:
    for dump in (dump_case, dump_json):
        dump(case, file)
        assert load_case(file) == case


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"gimpmd": 1, "gimpmd": 1}', "key 'gimpmd' appears twice"),
        ('{"gimpmd": 100000000000000000000}', "a whole number has more than 63 bits"),
        ('{"gimpmd": 1', "not valid YAML at line 1"),
    ],
)
def test_mistakes_in_json_are_named(file: Path, text: str, message: str) -> None:
    assert message in the_problem(file, text).message


def test_brackets_need_no_json(file: Path, plain: Plain) -> None:
    file.write_text(yaml.safe_dump(plain(), default_flow_style=True))
    assert load_case(file) == msgspec.convert(plain(), Case)


def test_what_was_measured_at_many_nodes_is_read(file: Path, plain: Plain) -> None:
    """A cube of atoms twelve cells wide has some 6,000 nodes near its planes."""
    count = 6000
    sites = Sites(
        vectors=((1.0, 0.0), (0.0, 1.0)),
        origin=(0.0, 0.0),
        basis=((0.0, 0.0),),
        shift=b"",
        period=(1.0, 1.0),
        layers=(1.0, 1.0),
        second=(Planes(left=1.0),),
        nodes=tuple(range(count)),
        force=np.random.default_rng(1).bytes(7 * 3 * 8 * count),
        stress=b"",
    )
    case = msgspec.convert(plain(), Case)
    case = msgspec.structs.replace(
        case, coupling=msgspec.structs.replace(case.coupling, sites=sites)
    )
    dump_json(case, file)
    assert file.stat().st_size > 1e6
    assert load_case(file) == case


def test_text_like_a_number_stays_text(file: Path, plain: Plain) -> None:
    raw = plain()
    raw["md"]["variables"] = {"label": "1e5"}
    case = msgspec.convert(raw, Case)
    dump_case(case, file)
    assert load_case(file) == case


scalars = st.none() | st.booleans() | whole | st.floats() | st.text(max_size=10) | st.dates()
anything = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from([*(k.split(".")[-1] for k in KEYS), "from", "to", "<<", "=", "x"]),
            inner,
            max_size=5,
        )
    ),
    max_leaves=20,
)


@given(key=st.sampled_from(KEYS), value=anything)
def test_fuzzed_values(file: Path, plain: Plain, key: str, value: object) -> None:
    """A case with anything at any key loads and can be used, or is refused with a list."""
    raw = put(plain(), key, value)
    file.write_text(yaml.safe_dump(raw, allow_unicode=True), encoding="utf-8", errors="replace")
    try:
        case = load_case(file)
    except InputError as error:
        assert error.problems  # noqa: PT017
        assert all(p.key and p.message for p in error.problems)  # noqa: PT017
    else:
        dump_case(case, file)


@given(st.data())
def test_fuzzed_text(file: Path, plain: Plain, data: st.DataObject) -> None:
    """Cuts and inserts in the text of a sound case never raise anything but `InputError`."""
    text = yaml.safe_dump(plain(), default_flow_style=None)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.integers(0, 6)))
        insert = data.draw(st.text("{}[]:,-&*!|>'\"%@`#?\n\t 0x_.eE+~<=ab\0\u2028", max_size=5))
        text = text[:start] + insert + text[end:]
    file.write_text(text, encoding="utf-8")
    try:
        load_case(file)
    except InputError as error:
        assert error.problems  # noqa: PT017


def test_a_huge_file_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "dump.yaml"
    path.write_text("- {x: 1.5, y: 2.5}\n" * 3_000_000)
    start = time.monotonic()
    with pytest.raises(InputError, match=r"dump\.yaml: 1 problem\n.*is larger than 500 kB"):
        load_case(path)
    assert time.monotonic() - start < 1.0
