"""Which variant of Mitsuba is taken, with Mitsuba itself replaced by programs that end as it may."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from clsim.errors import InputError
from tools.peers import mitsuba_variant
from tools.peers.mitsuba_variant import LLVM, SCALAR, load_mitsuba, variant_fault

ABORTS = f"""
import os, sys
if sys.argv[1] == "{LLVM}":
    print("LLVM ERROR: Cannot select", "a graph", sep="\\n", file=sys.stderr, flush=True)
    os.abort()
"""


@pytest.fixture(autouse=True)
def chosen(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The variants that were set in what stands for Mitsuba."""
    found: list[str] = []
    monkeypatch.setitem(sys.modules, "mitsuba", SimpleNamespace(set_variant=found.append))
    variant_fault.cache_clear()
    yield found
    variant_fault.cache_clear()


def trial(monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    monkeypatch.setattr(mitsuba_variant, "_TRIAL", program)


def test_a_variant_that_aborts_is_passed_over(monkeypatch: pytest.MonkeyPatch, chosen: list[str]) -> None:
    trial(monkeypatch, ABORTS)
    load_mitsuba(LLVM, SCALAR)
    assert chosen == [SCALAR]


def test_what_happened_is_told(monkeypatch: pytest.MonkeyPatch, chosen: list[str]) -> None:
    trial(monkeypatch, ABORTS)
    with pytest.raises(InputError, match=rf"{LLVM} ended with status -6 and said: LLVM ERROR: Cannot select$"):
        load_mitsuba()
    assert chosen == []


def test_each_variant_is_tried_once(monkeypatch: pytest.MonkeyPatch, chosen: list[str]) -> None:
    trial(monkeypatch, "")
    load_mitsuba()
    trial(monkeypatch, ABORTS)
    load_mitsuba()
    assert chosen == [LLVM, LLVM]


def test_a_trial_without_end_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    trial(monkeypatch, "import time; time.sleep(60)")
    monkeypatch.setattr(mitsuba_variant, "_TRIAL_S", 0.2)
    assert variant_fault(LLVM) == "took more than 0.2 s"


def test_without_mitsuba_nothing_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    monkeypatch.setattr(mitsuba_variant, "variant_fault", lambda variant: pytest.fail("tried"))
    with pytest.raises(InputError, match="Mitsuba 3 is not installed"):
        load_mitsuba()
