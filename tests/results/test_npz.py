"""What a file says of itself is not believed.  Oracle: numpy; by hand."""

import io
import zipfile

import numpy as np
import pytest

from nadia_balance.results.npz import read_npz


def test_reads_what_numpy_writes(tmp_path):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "names": np.array(["x", "yz"])}
    np.savez(tmp_path / "log.npz", **arrays)
    read = read_npz(tmp_path / "log.npz")
    assert {*read} == {*arrays}
    for name, array in arrays.items():
        assert (read[name] == array).all()


def test_an_array_larger_than_its_file_is_refused(tmp_path):
    """10^12 numbers, of which three are there."""
    buffer = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(buffer, header)
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("t.npy", buffer.getvalue() + 24 * b"\0")
    with pytest.raises(
        ValueError, match=r"t.npy says it is \(1000000000000,\)"
    ):
        read_npz(tmp_path / "log.npz")
    np.savez(tmp_path / "objects.npz", t=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        read_npz(tmp_path / "objects.npz")
