"""Clicks in a Meshcat, and a gamepad's sticks, without a browser."""

import struct

from pydrake.geometry import Meshcat


def click(meshcat: Meshcat, button: str) -> None:
    """Sends what a browser sends: {type: button, name: ...}."""
    meshcat._InjectWebsocketMessage(_packed({"type": "button", "name": button}))


def hold_sticks(meshcat: Meshcat, *axes: float) -> None:
    """Sends what a browser with a gamepad sends, whose axes are these."""
    gamepad = {"index": 0, "button_values": [], "axes": list(axes)}
    message = {"type": "gamepad", "name": "", "gamepad": gamepad}
    meshcat._InjectWebsocketMessage(_packed(message))


def _packed(value: object) -> bytes:
    """As MessagePack."""
    if isinstance(value, dict):
        items = [_packed(part) for item in value.items() for part in item]
        return bytes([0x80 | len(value)]) + b"".join(items)
    if isinstance(value, list):
        return bytes([0x90 | len(value)]) + b"".join(map(_packed, value))
    if isinstance(value, float):
        return b"\xcb" + struct.pack(">d", value)
    if isinstance(value, int):
        return bytes([value])  # below 128
    assert isinstance(value, str)
    size = len(value)
    head = [0xA0 | size] if size < 32 else [0xD9, size]
    return bytes(head) + value.encode()
