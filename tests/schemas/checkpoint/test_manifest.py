"""Checkpoints on disk: they are whole, or they do not count."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from gimpmd_schemas.checkpoint.manifest import (
    MANIFEST,
    Manifest,
    check_whole,
    committed,
    damage,
    digest_of,
    folder_of,
    write_manifest,
)
from gimpmd_schemas.errors import GimpmdError, InputError


def commit(run_dir: Path, step: int) -> Manifest:
    """A checkpoint with one file."""
    folder = folder_of(run_dir, step)
    folder.mkdir(parents=True)
    (folder / "md.0.h5").write_bytes(b"state" * step)
    manifest = Manifest(
        step=step,
        time=0.1 * step,
        state="abc",
        ranks={"md": 1},
        start_energy=0.1 + 0.2,
        files={"md.0.h5": digest_of(folder / "md.0.h5")},
    )
    write_manifest(run_dir, manifest)
    return manifest


def test_a_folder_without_a_manifest_does_not_count(tmp_path: Path) -> None:
    assert committed(tmp_path) == []
    first, second = commit(tmp_path, 9), commit(tmp_path, 10)
    folder_of(tmp_path, 30).mkdir()
    (folder_of(tmp_path, 30) / f"{MANIFEST}.part").write_text("{}")
    assert committed(tmp_path) == [second, first], "the latest comes first, bits are kept"


def test_a_checkpoint_that_was_set_aside_does_not_count(tmp_path: Path) -> None:
    commit(tmp_path, 9)
    place = folder_of(tmp_path, 9)
    place.rename(place.with_name("9.damaged"))
    assert committed(tmp_path) == []


@pytest.mark.parametrize("text", ["", "{", '{"step": -1}', "null"])
def test_a_manifest_that_cannot_be_read_is_named(tmp_path: Path, text: str) -> None:
    commit(tmp_path, 9)
    path = folder_of(tmp_path, 9) / MANIFEST
    path.write_text(text)
    with pytest.raises(InputError, match=r"rename .*checkpoints/9 to leave it out") as caught:
        committed(tmp_path)
    assert caught.value.file == str(path)


def test_damage_is_found(tmp_path: Path) -> None:
    manifest = commit(tmp_path, 9)
    path = check_whole(tmp_path, manifest, "md.0.h5")
    assert damage(tmp_path, manifest) == ""
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert "md.0.h5 is damaged" in damage(tmp_path, manifest)
    with pytest.raises(GimpmdError, match="damaged; resume from an older checkpoint"):
        check_whole(tmp_path, manifest, "md.0.h5")
    path.unlink()
    assert "md.0.h5 is missing" in damage(tmp_path, manifest)
    with pytest.raises(GimpmdError, match="no such file"):
        check_whole(tmp_path, manifest, "md.0.h5")


def test_a_manifest_is_plain_json(tmp_path: Path) -> None:
    manifest = commit(tmp_path, 3)
    text = (folder_of(tmp_path, 3) / MANIFEST).read_bytes()
    assert msgspec.json.decode(text)["ranks"] == {"md": 1}
    assert msgspec.json.decode(text, type=Manifest) == manifest
