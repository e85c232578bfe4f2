"""A Meshcat that remembers, and says what its recording shows at a time."""

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
        self.live = {}  # (path, name) -> value
        self.tracks = {}  # (path, name) -> {frame: value}

    def SetObject(self, path, shape, rgba=None):
        self.objects[path] = self.objects.get(path, 0) + 1
        self.colors[path] = rgba

    def SetTriangleMesh(self, path, vertices, faces, rgba):
        self.SetObject(path, None, rgba)

    def SetTransform(self, path, X, time=None):
        self._set(path, "transform", X.GetAsMatrix4(), time)

    def SetProperty(self, path, name, value, time=None):
        self._set(path, name, value, time)

    def HasPath(self, path):
        return path in self.objects

    def Delete(self, path):
        for store in (self.objects, self.colors):
            for key in [k for k in store if k.startswith(path)]:
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
