"""The compiled library: found, or said how to make it."""

import pytest

from nadia_balance.core.math import geometry


def test_says_how_the_library_is_built(monkeypatch, tmp_path):
    """Oracle: the message has the file and the command."""
    monkeypatch.setattr(geometry, "_PATH", tmp_path / "libgeometry.so.1")
    with pytest.raises(ImportError, match="libgeometry.so.1.*pip install"):
        geometry._library()


@pytest.mark.parametrize("size", [0, 1, 128, 129, 1000])
def test_there_is_room_for_all_numbers(size):
    """Oracle: the length, and zeros."""
    memory = geometry.room(size)
    assert len(memory) >= size and set(memory) <= {0.0}
