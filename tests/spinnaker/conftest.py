"""A PySpin that knows two cameras, and after each test a look at what was left of it."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest
from fake_pyspin import FakeDevice, FakePySpin


@pytest.fixture
def pyspin(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakePySpin]:
    """Whatever a test did: each image was given back once, and the system released as often as made."""
    module = FakePySpin(FakeDevice("20497219"), FakeDevice("20497220"))
    monkeypatch.setitem(sys.modules, "PySpin", module)
    yield module
    for device in module.devices:
        assert device.mistakes == []
        assert {image.releases for image in device.images} <= {1}
        assert not device.acquiring
    assert list(module.pointers) == []
    assert module.refused_releases == 0
    assert module.made == module.released


@pytest.fixture
def device(pyspin: FakePySpin) -> FakeDevice:
    """The first of the two cameras."""
    return pyspin.devices[0]
