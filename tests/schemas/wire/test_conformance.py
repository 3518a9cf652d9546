"""Results of checks as they travel."""

from __future__ import annotations

import msgspec
import pytest

from gimpmd_schemas.wire.conformance import Checked


@pytest.mark.parametrize("passed", [True, False, None])
def test_results_survive_the_way(passed: bool | None) -> None:
    result = Checked(group="course", what="ends", passed=passed, expected="0", came="3")
    assert msgspec.json.decode(msgspec.json.encode(result), type=Checked) == result


def test_a_group_that_does_not_exist() -> None:
    with pytest.raises(msgspec.ValidationError, match="group"):
        msgspec.json.decode(b'{"group": "other", "what": "ends", "passed": true}', type=Checked)
