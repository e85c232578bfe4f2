"""A small ONNX file, written by hand: a = W o + b, for any W and b."""

import json

import numpy as np

FLOAT = 1  # TensorProto.FLOAT


def linear_policy(W, b, shape=None, **metadata) -> bytes:
    """The bytes of a ModelProto with W (n, m), b (n,), and `metadata` in JSON.

    `shape` is that of the observation, by default (1, m).
    """
    n, m = W.shape
    graph = [
        (1, _node("MatMul", ["actor_obs", "W"], ["Wo"])),
        (1, _node("Add", ["Wo", "b"], ["action"])),
        (2, b"policy"),
        (5, _tensor("W", W.T)),
        (5, _tensor("b", b[None])),
        (11, _port("actor_obs", shape or (1, m))),
        (12, _port("action", (1, n))),
    ]
    texts = {name: json.dumps(value) for name, value in metadata.items()}
    model = [
        (1, 8),  # IR version
        (7, _message(graph)),
        (8, _message([(1, b""), (2, 17)])),  # operators of version 17
        *((14, _message([(1, k), (2, text)])) for k, text in texts.items()),
    ]
    return _message(model)


def _node(kind: str, inputs: list, outputs: list) -> bytes:
    ports = [(1, name) for name in inputs] + [(2, name) for name in outputs]
    return _message([*ports, (4, kind)])


def _tensor(name: str, values) -> bytes:
    data = np.asarray(values, dtype="<f4")
    sizes = [(1, size) for size in data.shape]
    return _message([*sizes, (2, FLOAT), (8, name), (9, data.tobytes())])


def _port(name: str, shape: tuple[int, ...]) -> bytes:
    sizes = _message([(1, _message([(1, size)])) for size in shape])
    tensor = _message([(1, FLOAT), (2, sizes)])
    return _message([(1, name), (2, _message([(1, tensor)]))])


def _message(fields: list) -> bytes:
    """Protobuf of (number, value): an int, or text or bytes."""
    parts = []
    for number, value in fields:
        if isinstance(value, int):
            parts += [_varint(number << 3), _varint(value)]
        else:
            data = value.encode() if isinstance(value, str) else value
            parts += [_varint(number << 3 | 2), _varint(len(data)), data]
    return b"".join(parts)


def _varint(value: int) -> bytes:
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _varint(rest) if rest else bytes([low])
