"""The replay of a run: one HTML file that needs nothing else."""

from pathlib import Path

from pydrake.geometry import Meshcat

from diagrams.meshcat_scene import FRAMES_PER_SECOND
from nadia_balance.systems import palette
from nadia_balance.systems.balance_visualizer import MIDDLE

# Keeps the middle of the robot in view: when it leaves a band about its last
# place, camera and target move along.  Turning and zooming remain the user's.
_FOLLOW = """
<script>
(() => {
  const path = "%s".split("/").filter((name) => name);
  const node = viewer.scene_tree.find(path);
  const band = 0.15;
  let last = null;
  viewer.follow = () => {
    const p = node.object.position;
    last = last || [p.x, p.y];
    const move = [p.x - last[0], p.y - last[1]].map(
        (d) => Math.sign(d) * Math.max(Math.abs(d) - band, 0));
    last = [last[0] + move[0], last[1] + move[1]];
    // The camera's axes are y up: its z is our -y.
    for (const v of [viewer.camera.position, viewer.controls.target]) {
      v.x += move[0];
      v.z -= move[1];
    }
  };
  viewer.set_render_callback("() => viewer.follow()");
})();
</script>
"""


def start_recording(meshcat: Meshcat, live: bool = False) -> None:
    """Records from now on; a `live` tab keeps moving meanwhile."""
    meshcat.DeleteRecording()
    meshcat.StartRecording(
        frames_per_second=FRAMES_PER_SECOND,
        set_visualizations_while_recording=live,
    )


def write_replay(meshcat: Meshcat, path: Path) -> None:
    """Ends the recording and writes it, with a legend, to `path`.

    A tab that is open gets the recording too.
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page, end, rest = meshcat.StaticHtml().rpartition("</body>")
    additions = _legend() + _FOLLOW % MIDDLE
    path.write_text(page + additions + end + rest, encoding="utf-8")


def _legend() -> str:
    """What the colours mean, in a corner of the page."""
    entries = "".join(
        f'<div><b style="color:{color}">&#9632;</b> {name}</div>'
        for name, color in palette.LEGEND.items()
    )
    return (
        '<div id="legend" style="position:fixed; left:14px; bottom:12px; '
        "padding:8px 12px; border-radius:8px; background:#ffffffc8; "
        'font:13px/1.45 sans-serif; color:#2f3440; pointer-events:none">'
        f"{entries}</div>"
    )
