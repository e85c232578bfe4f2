"""Clicks in a Meshcat without a browser."""

from pydrake.geometry import Meshcat


def click(meshcat: Meshcat, button: str) -> None:
    """Sends what a browser sends: {type: button, name: ...}."""

    def packed(text: str) -> bytes:  # as MessagePack
        size = len(text)
        head = [0xA0 | size] if size < 32 else [0xD9, size]
        return bytes(head) + text.encode()

    parts = ("type", "button", "name", button)
    meshcat._InjectWebsocketMessage(b"\x82" + b"".join(map(packed, parts)))
