"""What ipywidgets leaves out for the keyboard and for screen readers, added to an explorer once it is on the page.

In command mode Notebook 7 takes the arrow keys for itself before a slider sees them; a control marked
``data-lm-suppress-shortcuts`` keeps its keys (the mark must be on the very element that has the focus). Sliders have
no name of their own, and pictures no text in their place.
"""

from __future__ import annotations

import anywidget
import traitlets

ESM = """
function render({ model, el }) {
  let tries = 0, timer = null;
  const name = () => {
    const box = el.closest(".lx");
    if (!box) {  // not on the page yet
      if (tries++ < 100) timer = setTimeout(name, 50);
      return;
    }
    box.setAttribute("role", "group");
    box.setAttribute("aria-label", model.get("label"));
    const complete = () => {  // controls appear one after the other
      for (const e of box.querySelectorAll(".noUi-handle, select, input, button")) {
        e.setAttribute("data-lm-suppress-shortcuts", "true");
      }
      for (const row of box.querySelectorAll(".widget-inline-hbox")) {
        const label = row.querySelector("label.widget-label")?.textContent.trim();
        if (!label) continue;
        for (const e of row.querySelectorAll(".noUi-handle, select")) e.setAttribute("aria-label", label);
      }
      for (const image of box.querySelectorAll("img.widget-image")) image.alt = model.get("alt");
      if (tries++ < 20) timer = setTimeout(complete, 150);
    };
    tries = 0;
    complete();
  };
  name();
  return () => clearTimeout(timer);
}
export default { render };
"""


class Access(anywidget.AnyWidget):
    """Invisible; names the explorer it stands in (``label``), its sliders and its picture (``alt``)."""

    _esm = ESM
    label = traitlets.Unicode("").tag(sync=True)
    alt = traitlets.Unicode("").tag(sync=True)
