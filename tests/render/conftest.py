"""Kernels that tests of rendering share (``tests/shared_kernels.py``)."""

import pytest

from tests.shared_kernels import LIGHTS, MATERIALS, ORDINARY, widen


@pytest.fixture
def ordinary(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Build kernels that know what ordinary worlds have."""
    widen(monkeypatch, request, ORDINARY)


@pytest.fixture
def any_lights(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Build kernels that know lights of all kinds."""
    widen(monkeypatch, request, LIGHTS)


@pytest.fixture
def anything(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Build kernels that know lights, materials and textures of all kinds."""
    widen(monkeypatch, request, LIGHTS | MATERIALS)
