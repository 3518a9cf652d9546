"""The scheme of a continuum without atoms."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from gimpmd_gimp.coupling.scheme import Uncoupled


class Counter(SimpleNamespace):
    """A continuum that notes what it is asked for; its energies are the number of the step."""

    def start_step(self) -> None:
        self.calls.append("start")
        self.steps += 1

    def end_step(self) -> None:
        self.calls.append("end")

    def present_energies(self) -> int:
        self.calls.append("energies")
        return self.steps


@pytest.mark.parametrize("every", [1, 3])
def test_steps_are_taken_and_energies_summed_when_they_are_due(every) -> None:
    code = Counter(steps=0, calls=[])
    scheme = Uncoupled(code, every)
    found = []
    for _ in range(7):
        assert scheme.zone_fields() == {}
        scheme.finish()
        scheme.receive({})
        scheme.advance()
        found.append(scheme.energies())
    assert found == [step if step % every == 0 else None for step in range(7)]
    assert code.steps == 7
    assert code.calls.count("energies") == len(range(0, 7, every))
    assert [call for call in code.calls if call != "energies"] == ["start", "end"] * 7
    assert scheme.offers.size == scheme.needs.size == 0
