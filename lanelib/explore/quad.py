"""Four corners dragged on a picture: an anywidget of its own, for ipywidgets has nothing like it.

A corner is dragged with the pointer, or focused with Tab and moved with the arrow keys (with Shift by ten pixels).
`value` is the list of the four (x, y) in pixels of the picture, as the page sends it at most every `throttle_ms`.
"""

from __future__ import annotations

import anywidget
import cv2
import numpy as np
import traitlets

CORNERS = ("far left", "far right", "near right", "near left")

ESM = """
function render({ model, el }) {
  const NS = "http://www.w3.org/2000/svg";
  const make = (kind, attributes) => {
    const e = document.createElementNS(NS, kind);
    for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v);
    return e;
  };
  const [w, h] = model.get("size");
  const named = { role: "group", "aria-label": model.get("label") };
  const svg = make("svg", { viewBox: `0 0 ${w} ${h}`, class: "lx-quad", ...named });
  const image = make("image", { width: w, height: h });
  const area = make("polygon", { class: "lx-quad-area", "stroke-width": w / 450 });
  svg.append(image, area);
  let corners = [], dragged = -1, from = [0, 0], url = null, waiting = false;
  const clamp = (v, top) => Math.round(Math.min(top, Math.max(0, v)) * 10) / 10;
  const handles = model.get("names").map((name, i) => {
    const named = { role: "slider", "aria-label": `corner ${name}`, "data-lm-suppress-shortcuts": true };
    const g = make("g", { class: "lx-quad-corner", tabindex: 0, ...named });
    for (const [part, size] of [["ring", 60], ["dot", 320]]) {
      g.append(make("circle", { r: w / size, class: `lx-quad-${part}` }));
    }
    const inPicture = (e) => new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
    g.addEventListener("pointerdown", (e) => {
      const p = inPicture(e);
      dragged = i; from = [corners[i][0] - p.x, corners[i][1] - p.y];
      g.setPointerCapture(e.pointerId); g.focus(); e.preventDefault();
    });
    g.addEventListener("pointermove", (e) => {
      if (dragged !== i) return;
      const p = inPicture(e);
      move(i, p.x + from[0], p.y + from[1]);
    });
    for (const end of ["pointerup", "pointercancel"]) g.addEventListener(end, () => { dragged = -1; });
    g.addEventListener("keydown", (e) => {
      const d = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
      if (!d) return;
      const k = e.shiftKey ? 10 : 1;
      move(i, corners[i][0] + k * d[0], corners[i][1] + k * d[1]);
      e.preventDefault(); e.stopPropagation();
    });
    svg.append(g);
    return g;
  });
  const draw = () => {
    area.setAttribute("points", corners.map((p) => p.join()).join(" "));
    handles.forEach((g, i) => {
      const [x, y] = corners[i];
      g.setAttribute("transform", `translate(${x} ${y})`);
      g.setAttribute("aria-valuenow", x);
      g.setAttribute("aria-valuetext", `column ${x}, row ${y}`);
    });
  };
  const send = () => { waiting = false; model.set("value", corners.map((p) => [...p])); model.save_changes(); };
  const move = (i, x, y) => {
    corners[i] = [clamp(x, w - 1), clamp(y, h - 1)];
    draw();
    if (!waiting) { waiting = true; setTimeout(send, model.get("throttle_ms")); }
  };
  const setImage = () => {
    if (url) URL.revokeObjectURL(url);
    url = URL.createObjectURL(new Blob([model.get("image")], { type: "image/jpeg" }));
    image.setAttribute("href", url);
  };
  const setCorners = () => {
    if (dragged < 0 && !waiting) { corners = model.get("value").map((p) => [...p]); draw(); }
  };
  model.on("change:image", setImage); model.on("change:value", setCorners);
  setImage(); setCorners(); el.append(svg);
  return () => {
    model.off("change:image", setImage); model.off("change:value", setCorners);
    URL.revokeObjectURL(url);
  };
}
export default { render };
"""
CSS = """
.lx-quad {width: 100%; display: block; touch-action: none; border-radius: 3px;}
.lx-quad-area {fill: rgba(86, 180, 233, 0.16); stroke: #e69f00;}
.lx-quad-corner {cursor: grab; outline: none;}
.lx-quad-ring {fill: rgba(0, 0, 0, 0.28); stroke: #e69f00; stroke-width: 3;}
.lx-quad-dot {fill: #fff;}
.lx-quad-corner:hover .lx-quad-ring {stroke: #fff;}
.lx-quad-corner:focus .lx-quad-ring {stroke: #fff; stroke-width: 6; fill: rgba(0, 114, 178, 0.5);}
"""


class Quad(anywidget.AnyWidget):
    """The picture (H, W, 3) uint8 BGR and four corners on it, in the order of `CORNERS`."""

    _esm = ESM
    _css = CSS
    image = traitlets.Bytes(b"").tag(sync=True)
    size = traitlets.List(traitlets.Int(), [1280, 720]).tag(sync=True)
    value: traitlets.List[list[float]] = traitlets.List().tag(sync=True)
    names = traitlets.List(traitlets.Unicode(), list(CORNERS)).tag(sync=True)
    label = traitlets.Unicode("four corners to drag").tag(sync=True)
    throttle_ms = traitlets.Int(40).tag(sync=True)

    def __init__(self, picture_bgr: np.ndarray, corners_px, **options):
        height, width = picture_bgr.shape[:2]
        jpeg = cv2.imencode(".jpg", picture_bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
        super().__init__(image=jpeg, size=[width, height], value=plain(corners_px), **options)


def plain(corners_px) -> list[list[float]]:
    """Corners (4, 2) as the page sends them: tenths of a pixel."""
    return [[round(float(x), 1), round(float(y), 1)] for x, y in np.asarray(corners_px, float).reshape(4, 2)]
