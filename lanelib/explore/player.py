"""A play button that waits for its answer: the next frame is asked for when the last one is on the screen.

ipywidgets' own `Play` runs by the clock alone and its buttons have no names for a screen reader.
"""

from __future__ import annotations

import anywidget
import traitlets

ESM = """
function render({ model, el }) {
  const button = document.createElement("button");
  button.className = "jupyter-button widget-button lx-player";
  button.setAttribute("data-lm-suppress-shortcuts", "true");
  button.title = "play the clip, stop it";
  let timer = null;
  const draw = () => {
    const playing = timer !== null;
    button.textContent = playing ? "Stop" : "Play";
    button.setAttribute("aria-pressed", String(playing));
    button.classList.toggle("mod-active", playing);
  };
  const stop = () => { clearInterval(timer); timer = null; draw(); };
  const step = () => {
    if (!button.isConnected) return stop();
    if (model.get("answered") !== model.get("value")) return;
    model.set("value", model.get("value") >= model.get("last") ? 0 : model.get("value") + 1);
    model.save_changes();
  };
  button.addEventListener("click", () => {
    if (timer !== null) return stop();
    timer = setInterval(step, model.get("interval_ms"));
    draw();
  });
  draw();
  el.append(button);
  return () => clearInterval(timer);
}
export default { render };
"""


class Player(anywidget.AnyWidget):
    """Counts ``value`` up to ``last`` and begins again, every ``interval_ms``, as long as ``answered`` follows."""

    _esm = ESM
    value = traitlets.Int(0).tag(sync=True)
    last = traitlets.Int(1).tag(sync=True)
    answered = traitlets.Int(0).tag(sync=True)
    interval_ms = traitlets.Int(80).tag(sync=True)
