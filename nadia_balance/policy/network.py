"""The network of a policy: an ONNX file, run by onnxruntime."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import one_line


class Network:
    """A function from an observation (m,) to an action (n,).

    Attributes:
        name: of the file, as messages have it.
        path: of the file.
        metadata: texts in the file, by name.
    """

    def __init__(self, onnx: str | Path) -> None:
        """Loads the file.

        Args:
            onnx: its path.

        Raises:
            ValueError: it is not there, is no network, or onnxruntime is
                missing.
        """
        self.name, self.path = f"controller = {str(onnx)!r}", Path(onnx)
        self._session = _session(self.path, self.name)
        self.metadata: Mapping[str, str] = (
            self._session.get_modelmeta().custom_metadata_map
        )
        self._port = str(self._session.get_inputs()[0].name)

    def check_sizes(self, m: int, n: int) -> None:
        """Checks that the network has one input and one output.

        Args:
            m: size of the observation.
            n: size of the action.

        Raises:
            ValueError: they are others.
        """
        for kind, ports, size in (
            ("input", self._session.get_inputs(), m),
            ("output", self._session.get_outputs(), n),
        ):
            shapes = [port.shape for port in ports]
            has_rows = [
                len(s) == 2 and (s[0] == 1 or not isinstance(s[0], int))
                for s in shapes
            ]
            types = ", ".join(f"{port.type} {port.shape}" for port in ports)
            require(
                has_rows == [True]
                and shapes[0][1] == size
                and ports[0].type == "tensor(float)",
                f"{self.name}: must have one {kind} tensor(float) [1, {size}] "
                f"for its contract of {n} joints; has {types}",
            )

    def __call__(self, observation: Array) -> Array:
        """The action.

        Args:
            observation: that of a tick (m,).

        Returns:
            The action (n,).
        """
        row = observation.astype(np.float32)[None]
        return np.asarray(self._session.run(None, {self._port: row})[0][0])


def _session(onnx: Path, name: str) -> Any:
    """The network in the file `onnx`; errors begin with `name`."""
    require(onnx.is_file(), f"{name}: must be a file")
    try:
        import onnxruntime  # type: ignore[import-untyped]
    except ModuleNotFoundError:
        raise ValueError(
            f"{name}: must have its package: pip install onnxruntime"
        ) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(onnx), options)
    except Exception as error:  # its exceptions have no class in common
        raise ValueError(
            f"{name}: must be an ONNX model ({one_line(error)})"
        ) from None
