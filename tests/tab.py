"""What a Meshcat tab sends, without a browser."""


def click(meshcat, button):
    """Sends what it sends over its websocket: {type: button, name: ...}."""

    def packed(text):  # as MessagePack
        size = len(text)
        return bytes([0xA0 | size] if size < 32 else [0xD9, size]) + (
            text.encode()
        )

    parts = ("type", "button", "name", button)
    meshcat._InjectWebsocketMessage(b"\x82" + b"".join(map(packed, parts)))
