"""Text of a replay's page: title, clock, phase, story."""

import json

from nadia_balance.core.walking import Phase
from nadia_balance.results.log import Log, phase_spans
from nadia_balance.results.story import telling

# The viewer has no event for the time, so it is read in every frame.  The
# animation restarts at its end unless it is paused.
_PAGE = """
<div id="status" style="position:fixed; left:14px; top:12px; max-width:46%%;
padding:8px 12px; border-radius:8px; background:#ffffffc8; color:#2f3440;
font:14px/1.5 sans-serif; pointer-events:none"></div>
<script>
(() => {
  const {title, phases, story} = %s;
  const box = document.getElementById("status");
  const lines = ["b", "div", ...story.map(() => "div")].map(
      (tag) => box.appendChild(document.createElement(tag)));
  const animator = viewer.animator;
  let played = animator.playing;
  document.title = lines[0].textContent = title;
  const show = () => {
    if (played && !animator.playing && animator.time >= animator.duration) {
      animator.reset();
      animator.play();
    }
    played = animator.playing;
    // When it is paused and moved, only the actions know the time.
    const moved = Math.max(0, ...animator.actions.map((one) => one.time));
    const now = played ? animator.time : moved || animator.time;
    const phase = phases.filter(([start]) => start <= now).pop();
    const time = `t = ${now.toFixed(2)} s`;
    lines[1].textContent = phase ? `${time}, ${phase[1]}` : time;
    story.forEach(([start, text, color], i) => {
      const line = lines[i + 2];
      line.textContent = start <= now ? text : "";
      line.style.color = color;
      line.style.fontWeight = color ? "bold" : "";
    });
    requestAnimationFrame(show);
  };
  show();
})();
</script>
"""
_GOOD, _BAD = "#1b7a3d", "#c01a2e"  # colours of the last line


def replay_status(log: Log, summary: dict) -> str:
    """Returns the HTML of the status text of a replay.

    Each line of the story appears at its time; the last one, the result of the
    run, is shortened to its first part.
    """
    told = telling(log, summary)
    ends = _GOOD if summary["recovered"] else _BAD
    story = [[time, " ".join(text.split()), ""] for time, text in told[:-1]]
    story += [[t, text.split("   ")[0], ends] for t, text in told[-1:]]
    names = "scenario", "robot", "plant", "mechanisms"
    said = {
        "title": "  ·  ".join(str(summary[n]) for n in names if n in summary),
        "phases": [
            [
                span.start,
                "standing"
                if span.phase is Phase.STANDING
                else f"{span.swing_side.value} {span.phase.value}",
            ]
            for span in phase_spans(log)
        ],
        "story": story,
    }
    return _PAGE % json.dumps(said).replace("<", "\\u003c")
