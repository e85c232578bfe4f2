"""A Meshcat that remembers what was drawn; clicks in one without a browser."""

import numpy as np

FRAMES_PER_SECOND = 32.0


class FakeMeshcat:
    """Stands in for Drake's Meshcat, whose recordings cannot be read.

    A track holds the value of its first frame before it, and of its last
    after it; in between this fake asks for frames only.
    """

    def __init__(self):
        self.objects = {}  # path -> how often it was set
        self.colors = {}
        self.meshes = {}  # path -> triangles (n, 3, 3) [m]
        self.live = {}  # (path, name) -> value
        self.tracks = {}  # (path, name) -> {frame: value}

    def SetObject(self, path, shape, rgba=None):
        self.objects[path] = self.objects.get(path, 0) + 1
        self.colors[path] = rgba

    def SetTriangleMesh(self, path, vertices, faces, rgba):
        self.SetObject(path, None, rgba)
        self.meshes[path] = vertices.T[faces.T]

    def SetTransform(self, path, X, time=None):
        self._set(path, "transform", X.GetAsMatrix4(), time)

    def SetProperty(self, path, name, value, time=None):
        self._set(path, name, value, time)

    def HasPath(self, path):
        return path in self.objects

    def Delete(self, path):
        for store in (self.objects, self.colors, self.meshes):
            for key in [k for k in store if f"{k}/".startswith(f"{path}/")]:
                del store[key]

    def _set(self, path, name, value, time):
        self.live[path, name] = value
        if time is not None:
            frame = round(time * FRAMES_PER_SECOND)
            self.tracks.setdefault((path, name), {})[frame] = value

    def at(self, path, name, time):
        """What the recording shows at `time` [s]."""
        track = self.tracks.get((path, name))
        if not track:
            return self.live[path, name]
        frames = np.array(sorted(track))
        before = frames[frames <= round(time * FRAMES_PER_SECOND)]
        return track[before[-1] if len(before) else frames[0]]


def drawn_edges(meshcat: FakeMeshcat, path: str, time: float):
    """The visible edges of a PolygonOutline: starts, ends and heights.

    From the poses and lengths of the boxes, which are longer by their width.
    """
    starts, ends, heights = [], [], []
    for edge in [p for p in meshcat.objects if p.rpartition("/")[0] == path]:
        if meshcat.at(edge, "visible", time):
            X = meshcat.at(edge, "transform", time)
            scale = meshcat.at(f"{edge}/<object>", "scale", time)
            half = 0.5 * (scale[0] - scale[1]) * X[:2, 0]
            starts.append(X[:2, 3] - half)
            ends.append(X[:2, 3] + half)
            heights.append(X[2, 3])
    return starts, ends, heights


def drawn_triangles(meshcat: FakeMeshcat, path: str, time: float):
    """The visible triangles (n, 3, 3) [m] of a ConvexShape."""
    seen = [
        mesh
        for name, mesh in meshcat.meshes.items()
        if name.rpartition("/")[0] == path and meshcat.at(name, "visible", time)
    ]
    return np.concatenate([np.empty((0, 3, 3)), *seen])


def click(meshcat, button: str) -> None:
    """Sends what a browser sends: {type: button, name: ...}."""

    def packed(text):  # as MessagePack
        size = len(text)
        return bytes([0xA0 | size] if size < 32 else [0xD9, size]) + (
            text.encode()
        )

    parts = ("type", "button", "name", button)
    meshcat._InjectWebsocketMessage(b"\x82" + b"".join(map(packed, parts)))
