"""How long dashes are: the period of dash and gap along a lane's lines, a ruler that lies on every motorway.

On the road the period is set by regulation (``DASH_PERIODS_M``). On a rig's scale it comes out right only if
distances along the road do, y = height focal / (v - v0): it checks the rig's longitudinal scale, and can set an
unknown focal length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lanelib.finder import LaneFinder
from lanelib.jointfit import BEND, JointFit, distance, line_x
from lanelib.paint import paint_evidence, weight_of
from lanelib.rig import SCAN_COLUMN_M, Rig

# 12 ft of dash and 36 ft of gap (Caltrans Standard Plan A20A); 10 and 30 ft (US manual, sec. 3A.06)
DASH_PERIODS_M = {"California": 14.63, "federal": 12.19}
DASH_NEAR = 0.11  # relative: a period further from both is of another norm, or the scale is quite wrong
DASH_RANGE_M = (5.0, 45.0)  # three periods; beyond, a pixel is longer than a third of a dash
DASH_PERIODS_TRIED_M = (7.5, 22.0)  # the world's roads have 8-18 m; 22 where the focal length is guessed 20 % too long
DASH_SYSTEMATIC = 0.015  # relative: what blur, slope and the few periods in view leave, on roads of known truth
DASH_CORRELATION = 0.6  # of a profile with a square wave; broken solid lines reach less
# the fit's distances are along the car's axis: at 40 m of such a curve 0.2 % short of the road's
DASH_CURVED_1PM = 1 / 400


@dataclass(frozen=True, eq=False)
class DashPeriod:
    """Length of dash plus gap on the rig's scale, in metres; falsy with a ``reason`` where no dashes were seen."""

    period_m: float = math.nan
    std_m: float = math.nan
    n_lines: int = 0
    reason: str = ""

    def __bool__(self):
        return not self.reason

    def __iter__(self):
        return iter((self.period_m, self.std_m))

    def __repr__(self):
        return self.compared()

    def compared(self, given_m: float | None = None) -> str:
        """The period in words, beside the one that was ``given_m`` (then it set the scale), else the nearest norm."""
        if not self:
            return f"no dash period: {self.reason}"
        lines = "1 line" if self.n_lines == 1 else f"{self.n_lines} lines"
        measured = f"dash period {self.period_m:.2f} +- {self.std_m:.2f} m measured on {lines}"
        if given_m is not None:
            return f"{measured}: set to {given_m:g} m as given"
        name, length = min(DASH_PERIODS_M.items(), key=lambda item: abs(math.log(self.period_m / item[1])))
        off = self.period_m / length - 1
        if abs(off) > DASH_NEAR:
            norms = ", ".join(f"{name} {norm}" for name, norm in DASH_PERIODS_M.items())
            return f"{measured}: near no norm of the US ({norms})"
        return f"{measured}: nearest norm {length} ({name}), longitudinal scale off by {100 * off:+.1f} %"


def line_profile(finder: LaneFinder, frame_bgr: np.ndarray, fit: JointFit, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Paint along a line of ``fit``, the left (``side`` -1) or right (+1) one.

    Distances (N,) in metres, descending, and weights (N,) 0..1.
    """
    view, mean = finder.view((frame_bgr.shape[1], frame_bgr.shape[0])), fit.mean
    z = paint_evidence(view.scan(frame_bgr), column_m=SCAN_COLUMN_M)
    y = distance(1 / view.grid.y_m, mean, view.height_m)
    column = view.grid.column_of(line_x(y, mean, side) / y * view.grid.y_m)
    inside = (column > 4) & (column < len(view.grid.x_m) - 5)
    rows = np.flatnonzero((y > DASH_RANGE_M[0]) & (y < DASH_RANGE_M[1]) & inside)
    around = z[rows[:, None], np.round(column[rows]).astype(int)[:, None] + np.arange(-3, 4)]  # 15 cm either side
    return y[rows], weight_of(around.max(axis=1))


def dash_likelihood(y_m, weight, periods_m, blur_m) -> tuple[np.ndarray, float]:
    """Log likelihood (P,) of each period for one profile (N,), and the best correlation found.

    A square wave of every phase and of two duty cycles, blurred as the picture blurs it (``blur_m`` (N,)), is
    compared with the profile; log L = -n / 2 log(1 - r^2) for correlation r of n independent values, here a quarter
    of the rows.
    """
    w = weight - weight.mean()
    phases = np.arange(32) / 32
    likelihood, best = np.zeros(len(periods_m)), 0.0
    for i, period in enumerate(periods_m):
        u = y_m[None, :] / period - phases[:, None]
        half = blur_m[None, :] / (2 * period)
        r = max(float(_correlation(_covered(u, half, duty), w).max()) for duty in (0.25, 0.4))
        best = max(best, r)
        likelihood[i] = -len(w) / 8 * math.log(1 - min(max(r, 0.0), 0.999) ** 2)
    return likelihood, best


def _covered(u, half, duty):
    """Share of [u - half, u + half] covered by paint that fills the first ``duty`` of every period of 1.

    (`road.Marking.coverage` does the same in metres.)
    """

    def upto(t):
        whole = np.floor(t)
        return whole * duty + np.minimum(t - whole, duty)

    return (upto(u + half) - upto(u - half)) / (2 * half)


def _correlation(templates, w):
    t = templates - templates.mean(axis=1, keepdims=True)
    return t @ w / np.sqrt((t * t).sum(axis=1) * (w @ w) + 1e-9)


def dash_period(rig: Rig, frames: list[np.ndarray]) -> DashPeriod:
    """The period of the dashes of the ego lane's lines in ``frames``, each (H, W, 3) uint8 BGR, on the rig's scale.

    Each dashed line of each frame gives a likelihood over periods. Their sum has its peak at the period; the standard
    deviation is its spread under resampling of the lines (bootstrap, Efron 1979), and a systematic part.
    """
    finder = LaneFinder(rig, track=False)
    periods = np.geomspace(*DASH_PERIODS_TRIED_M, 240)
    focal_px, height_m = rig.camera.camera_matrix[1, 1], rig.mounting["height_m"]
    found = []
    for frame in frames:
        fit = finder.process(frame).fit
        if fit is None or abs(2 * fit.mean[BEND]) > DASH_CURVED_1PM:
            continue
        for side in (-1, 1):
            y, weight = line_profile(finder, frame, fit, side)
            if len(y) < 30 or not 0.08 < weight.mean() < 0.7:
                continue
            # the length on the road of a pixel, or of a row of the scan
            blur = np.maximum(y * y / (focal_px * height_m), np.abs(np.gradient(y)))
            curve, best = dash_likelihood(y, weight, periods, blur)
            if best > DASH_CORRELATION:
                found.append(curve)
    if not found:
        return DashPeriod(reason="no dashed line was clear enough")
    curves = np.array(found)
    total = curves.sum(axis=0)
    top = int(total.argmax())
    if top in (0, len(periods) - 1):
        return DashPeriod(n_lines=len(curves), reason=f"no period between {periods[0]:.0f} and {periods[-1]:.0f} m")
    likely = np.exp(np.clip(total - total.max(), -50, 0))
    mean = float(likely @ np.log(periods) / likely.sum())
    std = math.sqrt(float(likely @ (np.log(periods) - mean) ** 2 / likely.sum()))
    if len(curves) > 4:
        rng = np.random.default_rng(0)
        again = [periods[curves[rng.integers(len(curves), size=len(curves))].sum(axis=0).argmax()] for _ in range(100)]
        std = max(std, float(np.std(np.log(again))))
    return DashPeriod(math.exp(mean), math.exp(mean) * math.hypot(std, DASH_SYSTEMATIC), len(curves))
