"""The frame of every explorer: controls, a picture, read-outs; one function fills it.

A control's change calls the explorer's function with the values of all controls; the picture goes out as JPEG bytes
(40 ms from key press to screen, a redrawn matplotlib figure takes 500), the numbers as one piece of HTML. Picture and
numbers always belong together. ipywidgets holds back further changes while one is answered, so a fast drag is thinned
out and nothing piles up.
"""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager

import ipywidgets as W
import numpy as np

from lanelib.errors import LanelibError
from lanelib.explore.access import Access
from lanelib.explore.look import WIDTH_PX, Look, message_card, readings_html

STYLE = """<style>
.lx {max-width: 960px;}
.lx .lx-controls {flex-flow: row wrap; column-gap: 18px; row-gap: 2px; align-items: center;
  padding-bottom: 6px;}
.lx .lx-title {font-weight: 600; font-size: 15px; margin: 2px 0;}
.lx .lx-readings {display: grid; grid-template-columns: repeat(auto-fill, minmax(148px, 1fr)); gap: 6px;
  margin: 6px 0 2px;}
.lx .lx-readings > div {border-left: 3px solid #56b4e9; padding: 1px 4px 1px 8px; line-height: 1.3;}
.lx .lx-readings dt, .lx .lx-readings dd {display: block; float: none; width: auto; margin: 0; padding: 0;
  text-align: left;}
.lx .lx-readings dt {font-size: 12px; color: var(--jp-ui-font-color1, #333); font-weight: 400;}
.lx .lx-readings dd {font-variant-numeric: tabular-nums;}
.lx .lx-readings > .lx-wide {grid-column: 1 / -1;}
.lx .lx-value {font-size: 15px; font-weight: 600; color: var(--jp-content-font-color1, #000);}
.lx .lx-truth {font-size: 12px; color: var(--jp-ui-font-color1, #333);}
.lx .lx-note {font-size: 12px; color: var(--jp-ui-font-color2, #555); line-height: 1.4;}
.lx .lx-alert {border-left: 4px solid #d55e00; padding: 4px 10px; margin: 4px 0; font-weight: 600; line-height: 1.4;}
.lx .lx-code {font-family: var(--jp-code-font-family, monospace); font-size: 12px; line-height: 1.45;
  overflow-x: auto; user-select: text; margin: 6px 0 0; padding: 8px 10px; background: var(--jp-layout-color2, #eee);
  color: var(--jp-content-font-color1, #000);}
.lx .widget-image {border-radius: 3px;}
.lx .widget-box, .lx > .widget-html, .lx .widget-image {margin: 0;}
.lx .noUi-handle:focus-visible, .lx button:focus-visible, .lx select:focus-visible {outline: 3px solid #0072b2;
  outline-offset: 1px;}
</style>"""
CONTROL = {"flex": "1 1 300px", "max_width": "440px", "min_width": "260px"}


# ------------------------------------------------------------------------------------------------ controls
def slider(name: str, value: float, low: float, high: float, step: float, *, digits: int = 2, tip: str = ""):
    """A slider of real numbers, labelled ``name``; its lower end gives way so that ``value`` is a whole number of steps
    above it, for the page moves any other value to the next step."""
    low = value - round((value - low) / step) * step
    return W.FloatSlider(value=value, min=low, max=high, step=step, readout_format=f".{digits}f", **_labels(name, tip))


def counter(name: str, value: int, low: int, high: int, *, step: int = 1, tip: str = ""):
    """A slider of whole numbers."""
    return W.IntSlider(value=value, min=low, max=high, step=step, **_labels(name, tip))


def choice(name: str, options, value=None, *, tip: str = ""):
    """A list to choose one from: names, or pairs (name, value)."""
    return W.Dropdown(options=options, value=value, **_labels(name, tip))


def tick(name: str, value: bool = False, *, tip: str = ""):
    """A check box."""
    return W.Checkbox(value=value, indent=False, description=name, tooltip=tip or name, layout=W.Layout(width="auto"))


def button(name: str, action: Callable[[], object], *, tip: str = "") -> W.Button:
    """A button that calls ``action()``."""
    made = W.Button(description=name, tooltip=tip or name, layout=W.Layout(width="auto"))
    made.on_click(lambda _: action())
    return made


def _labels(name: str, tip: str) -> dict:
    return {
        "description": name,
        "tooltip": tip or name,
        "style": {"description_width": "118px"},
        "layout": W.Layout(**CONTROL),
    }


# ------------------------------------------------------------------------------------------------ the frame
class Explorer(W.VBox):
    """A widget: ``controls`` by name, the ``look`` they give now, its ``values`` by name.

    ``make(**values of the controls)`` gives the `Look`. A `LanelibError` of it is shown as a message in place of the
    picture, for it tells a person what to do. Anything else is a fault: it is shown, too, and raised.
    """

    def __init__(
        self,
        title: str,
        make: Callable[..., Look],
        controls: Mapping[str, W.Widget],
        *,
        hidden: Iterable[str] = (),
        buttons: Iterable[W.Widget] = (),
        beside: W.Widget | None = None,
        below: Iterable[W.Widget] = (),
        alt: str = "",
    ):
        self.title, self.controls, self._make = title, dict(controls), make
        self._held, self.milliseconds = 0, 0.0
        self.look = Look(np.zeros((300, WIDTH_PX, 3), np.uint8))  # until there is one
        self._asked, self._lock = 0, threading.RLock()
        hidden = set(hidden)
        self.picture = W.Image(format="jpeg", layout=W.Layout(width="100%", height="auto", object_fit="contain"))
        self.numbers = W.HTML(layout=W.Layout(width="100%"))
        shown = [control for name, control in self.controls.items() if name not in hidden]
        panel = W.Box([*shown, *buttons], layout=W.Layout(width="100%"))
        panel.add_class("lx-controls")
        self.pane = W.Box([self.picture], layout=W.Layout(width="100%"))
        picture = self.pane
        if beside is not None:
            layout = W.Layout(width="100%", flex_flow="row", align_items="flex-start")
            picture = W.Box([beside, self.pane], layout=layout)
        head = W.HTML(f'{STYLE}<div class="lx-title">{html.escape(title)}</div>')
        access = Access(label=title, alt=alt or title, layout=W.Layout(display="none"))
        super().__init__([head, panel, picture, *below, self.numbers, access], layout=W.Layout(width="100%"))
        self.add_class("lx")
        for control in self.controls.values():
            control.observe(self._changed, "value")
        self.refresh()

    @property
    def state(self) -> dict:
        """The values of all controls by name."""
        return {name: control.value for name, control in self.controls.items()}

    @property
    def values(self) -> dict:
        """The numbers shown, by name."""
        return self.look.values

    def set(self, **values) -> None:
        """Move several controls at once; one answer for all of them."""
        with self.together():
            for name, value in values.items():
                self.controls[name].value = value

    @contextmanager
    def together(self):
        """Within it controls may be moved; the answer comes at the end."""
        self._held += 1
        try:
            yield
        finally:
            self._held -= 1
        self._changed(None)

    def _changed(self, change) -> None:
        if not self._held:
            self.refresh()

    def refresh(self) -> None:
        """Ask for the look of the controls as they stand, and show it.

        JupyterLab handles the messages of widgets in threads of their own (subshells), so a second change may come in
        while the first is answered: one answer at a time, and of those who wait only the last one asks again.
        """
        self._asked += 1
        mine = self._asked
        with self._lock:
            if mine == self._asked:
                self._answer()

    def _answer(self) -> None:
        begin = time.perf_counter()
        note = ""
        try:
            self.look = self._make(**self.state)
        except LanelibError as error:
            self.look = Look(message_card(str(error), self._size_wh()))
            note = f'<div class="lx-alert" role="alert">{html.escape(str(error))}</div>'
        except Exception as error:
            message = f"a fault in this explorer, {type(error).__name__}: {error}"
            self.look = Look(message_card(message, self._size_wh()))
            self._show(f'<div class="lx-alert lx-fault" role="alert">{html.escape(message)}</div>')
            raise
        self.milliseconds = (time.perf_counter() - begin) * 1e3
        self._show(note or readings_html(self.look.readings))

    def _show(self, numbers: str) -> None:
        self.picture.value = self.look.jpeg()
        self.picture.layout.max_width = f"{self.look.picture.shape[1]}px"
        code = f'<pre class="lx-code" tabindex="0" aria-label="code">{html.escape(self.look.code)}</pre>'
        self.numbers.value = numbers + (code if self.look.code else "")

    def _size_wh(self) -> tuple[int, int]:
        return self.look.picture.shape[1], self.look.picture.shape[0]

    def __repr__(self) -> str:
        return f"Explorer({self.title!r}: {', '.join(self.controls)})"
