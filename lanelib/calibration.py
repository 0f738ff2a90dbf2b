"""Chessboards to a camera (Z. Zhang, "A flexible new technique for camera calibration", 2000; solved by OpenCV).

Every picture of a board of known squares gives the pixels of its inner corners. The one camera, and the one pose of
each board, that bring the projected corners nearest to the seen ones are the calibration. What makes it good is many
boards, tilted in different ways, up to the edges of the frame; so a board the frame cuts off is used as far as seen.
"""

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from lanelib.camera import ASPECT_TOLERANCE, INTRINSICS, Camera
from lanelib.chessboard import check_board_wh, find_board
from lanelib.errors import LanelibError
from lanelib.files import write_bytes
from lanelib.pictures import pictures_in, read_image

MIN_BOARDS = 3  # two views give Zhang's equations just enough; the third is the first that can contradict them
CROP_PX = 2  # 1281x721 beside 1280x720: a row or column too many, not another scale
OUTLIER_FACTOR = 3.0  # times the median of the boards; the worst of 20 boards of a bent sheet has 1.5
OUTLIER_FLOOR_PX = 0.3  # below this a board does no harm, however good the others are
MIN_TILT_DEG = 10.0  # boards all parallel leave the focal length free, and its standard deviation does not tell


@dataclass(frozen=True, eq=False, repr=False)
class BoardView:
    """What became of one picture: whether it was used, what is to be said, and its reprojection error.

    corners_wh : the grid that was seen; corners_px : ndarray (w * h, 2), pixels of a picture of the camera's size;
    rms_px : root mean square over the board's corners of their distance from the projected ones
    """

    name: str
    used: bool
    reason: str = ""
    rms_px: float | None = None
    corners_wh: tuple[int, int] | None = None
    corners_px: np.ndarray | None = None

    def __repr__(self) -> str:
        grid = "" if self.corners_wh is None else f", {self.corners_wh[0]}x{self.corners_wh[1]} corners"
        rms = "" if self.rms_px is None else f", {self.rms_px:.2f} px"
        reason = f" ({self.reason})" if self.reason else ""
        return f"{self.name}: {'used' if self.used else 'not used'}{grid}{rms}{reason}"


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A camera and where it comes from.

    rms_px : square root of the mean, over all corners of all used boards, of du^2 + dv^2 between seen and projected
    flat : False if the shape of the board was estimated too
    board_m : ndarray (w * h, 3), metres: the corners of the board as calibrated, z = 0 if flat
    """

    camera: Camera
    boards: tuple[BoardView, ...]
    rms_px: float
    flat: bool
    board_m: np.ndarray

    def __repr__(self) -> str:
        used = sum(board.used for board in self.boards)
        shape = "flat" if self.flat else "bent"
        return f"Calibration, {shape} board, {used} of {len(self.boards)} pictures used: {self.camera!r}"

    def save(self, path) -> Path:
        """Write camera and boards as one JSON file, which `Camera.load` reads; completely or not at all."""
        keys = ("name", "used", "reason", "rms_px", "corners_wh")
        boards = [{key: getattr(board, key) for key in keys} for board in self.boards]
        numbers = {**self.camera.to_dict(), "flat": self.flat, "boards": boards}
        return write_bytes(path, (json.dumps(numbers, indent=1) + "\n").encode())


def calibrate(
    pictures,
    *,
    board_wh: tuple[int, int] = (9, 6),
    square_m: float = 1.0,
    flat: bool = True,
    outlier_factor: float = OUTLIER_FACTOR,
) -> Calibration:
    """Calibrate a camera from pictures of a chessboard, with five distortion coefficients.

    Parameters
    ----------
    pictures : a folder, or paths, or pairs (name, image) with image (H, W, 3) BGR or (H, W), uint8
    board_wh : inner corners of the board in a row and in a column
    square_m : side of a square in metres; the camera does not depend on it, the poses of the boards would
    flat : True trusts the board to be a plane; False estimates its shape as well (OpenCV's `calibrateCameraRO`, after
        K. H. Strobl and G. Hirzinger, "More accurate pinhole camera calibration with imperfect planar target", 2011),
        which needs whole boards and takes some seconds. For a sheet of paper; with w + h even hold it one way up
    outlier_factor : a board whose error is more than this times the median is left out, the worst first

    Returns
    -------
    Calibration : all pictures are in `boards`, in the order given, with the reason where one was not used

    Raises
    ------
    LanelibError : fewer than three usable boards, no whole board among them, or boards that do not determine a camera
    """
    board_wh = check_board_wh(board_wh)
    if not (np.isfinite(square_m) and square_m > 0 and outlier_factor > 1):
        raise LanelibError(
            f"calibrate: need square_m above 0 and outlier_factor above 1, found {square_m} and {outlier_factor}"
        )
    views, sizes = [], []
    for name, image in _images(pictures):
        view, size_wh = _look(name, image, board_wh)
        views.append(view)
        sizes.append(size_wh)
    size_wh = _common_size(views, sizes)
    views = [_fit_size(view, found, size_wh) if view.used else view for view, found in zip(views, sizes, strict=True)]
    views = _without_repetitions(views)
    if not flat:
        views = _whole_ones(views, board_wh)

    while True:
        _check_enough(views, board_wh)
        solution = _solve(views, board_wh, square_m, size_wh, flat=flat)
        used = [i for i, view in enumerate(views) if view.used]
        for i, rms_px in zip(used, solution.per_board_px, strict=True):
            views[i] = replace(views[i], rms_px=float(rms_px))
        median = float(np.median(solution.per_board_px))
        worst = used[int(np.argmax(solution.per_board_px))]
        worst_px = float(solution.per_board_px.max())
        if worst_px <= max(outlier_factor * median, OUTLIER_FLOOR_PX):
            break
        reason = f"outlier: {worst_px:.2f} px, the median board {median:.2f} px"
        views[worst] = replace(views[worst], used=False, reason=_join(views[worst].reason, reason))

    if solution.tilt_deg < MIN_TILT_DEG:
        raise LanelibError(
            f"calibrate: need boards tilted by {MIN_TILT_DEG:g} degrees or more against each other, found at most "
            f"{solution.tilt_deg:.0f} in {len(used)} pictures; take more, each at another angle"
        )
    return Calibration(solution.camera, tuple(views), solution.rms_px, flat, solution.board_m)


def board_points(corners_wh: tuple[int, int], square_m: float = 1.0) -> np.ndarray:
    """Corners of a flat board in its own axes, row by row: (w * h, 3) float32 in metres, z = 0."""
    w, h = corners_wh
    points = np.zeros((w * h, 3), np.float32)
    points[:, :2] = np.mgrid[0:w, 0:h].T.reshape(-1, 2) * square_m
    return points


@dataclass(frozen=True, eq=False)
class _Solution:
    """What OpenCV made of the boards: the camera, errors in pixels, the board's corners (w * h, 3) in metres, and the
    largest angle between two of the boards."""

    camera: Camera
    rms_px: float
    per_board_px: np.ndarray
    board_m: np.ndarray
    tilt_deg: float


def _solve(views, board_wh, square_m, size_wh, *, flat: bool) -> _Solution:
    used = [view for view in views if view.used]
    seen = [view.corners_px.astype(np.float32).reshape(-1, 1, 2) for view in used]
    # Where a cut-off board begins does not matter: a shift along the board is part of its pose.
    known = [board_points(view.corners_wh, square_m) for view in used]
    board_m = board_points(board_wh, square_m)
    try:
        if flat:
            out = cv2.calibrateCameraExtended(known, seen, size_wh, None, None)
            rms_px, matrix, distortion, rvecs, _, std, *_, per_board = out
        else:
            # The first, the last and this corner keep their places, as the method asks: the far end of the first row.
            fixed = board_wh[0] - 1
            out = cv2.calibrateCameraROExtended(known, seen, size_wh, fixed, None, None)
            rms_px, matrix, distortion, rvecs, _, corners_m, std, *_, per_board = out
            board_m = np.array(corners_m, np.float64).reshape(-1, 3)
    except cv2.error as error:
        reason = " ".join(str(error.err).split()) or "no solution"
        raise LanelibError(f"calibrate: need boards that agree on one camera, found {reason}; retake them") from None
    std = dict(zip(INTRINSICS, np.array(std, np.float64).ravel().tolist(), strict=False))
    if not np.isfinite([rms_px, *std.values(), *matrix.ravel(), *np.ravel(distortion)]).all():
        raise LanelibError("calibrate: need boards that agree on one camera, found no finite solution; retake them")
    rms_px = float(rms_px)
    camera = Camera(matrix, np.ravel(distortion)[:5], size_wh, rms_px, std)
    normals = np.array([cv2.Rodrigues(np.asarray(rvec))[0][:, 2] for rvec in rvecs])
    tilt_deg = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min())))
    return _Solution(camera, rms_px, np.ravel(per_board), board_m, tilt_deg)


def _images(pictures):
    """(name, image or LanelibError) one at a time, so that only one picture is in memory."""
    if isinstance(pictures, str | Path):
        folder = Path(pictures)
        if not folder.is_dir():
            raise LanelibError(f"{folder}: need a folder of chessboard pictures, found none; check the name")
        pictures = pictures_in(folder)
        if not pictures:
            raise LanelibError(f"{folder}: need chessboard pictures (.jpg, .png or .bmp), found none; check the folder")
    elif not isinstance(pictures, Iterable):
        raise LanelibError(f"calibrate: need pictures of a chessboard, found {type(pictures).__name__}")
    for picture in pictures:
        if isinstance(picture, str | Path):
            try:
                yield Path(picture).name, read_image(picture)
            except LanelibError as error:
                yield Path(picture).name, error
        elif isinstance(picture, tuple) and len(picture) == 2:
            yield str(picture[0]), picture[1]
        else:
            raise LanelibError(f"calibrate: need paths or pairs (name, image), found {type(picture).__name__}")


def _look(name: str, image, board_wh) -> tuple[BoardView, tuple[int, int] | None]:
    try:
        if isinstance(image, LanelibError):
            raise image
        board = find_board(image, board_wh)
    except LanelibError as error:
        return BoardView(name, False, str(error).split(": ", 1)[-1]), None
    size_wh = image.shape[1::-1]
    if board.corners_wh is None:
        return BoardView(name, False, board.reason), size_wh
    part = "" if board.corners_wh == board_wh else f"{_wh(board.corners_wh)} of {_wh(board_wh)} corners in view"
    return BoardView(name, True, part, None, board.corners_wh, board.corners_px), size_wh


def _common_size(views, sizes) -> tuple[int, int] | None:
    """The size of most pictures that show a board."""
    counts = Counter(size for view, size in zip(views, sizes, strict=True) if view.used)
    return counts.most_common(1)[0][0] if counts else None


def _fit_size(view: BoardView, found_wh, size_wh) -> BoardView:
    """Bring the corners of a picture of a slightly or proportionally different size to the common one."""
    (fw, fh), (w, h) = found_wh, size_wh
    if (fw, fh) == (w, h):
        return view
    if abs(fw - w) <= CROP_PX and abs(fh - h) <= CROP_PX:
        return replace(view, reason=_join(view.reason, f"{fw}x{fh}, taken as {w}x{h} from its upper left corner"))
    sx, sy = w / fw, h / fh
    if abs(sx / sy - 1) <= ASPECT_TOLERANCE:
        assert view.corners_px is not None
        corners_px = (view.corners_px + 0.5) * (sx, sy) - 0.5
        return replace(view, corners_px=corners_px, reason=_join(view.reason, f"{fw}x{fh}, scaled to {w}x{h}"))
    return replace(view, used=False, reason=_join(view.reason, f"{fw}x{fh} is not in proportion to {w}x{h}"))


def _without_repetitions(views: list[BoardView]) -> list[BoardView]:
    """A picture given twice says nothing new, but would make the standard deviations smaller than they are."""
    seen: dict[bytes, str] = {}
    result = []
    for view in views:
        key = view.corners_px.tobytes() if view.used and view.corners_px is not None else b""
        if view.used and key in seen:
            view = replace(view, used=False, reason=f"the same picture as {seen[key]}")
        elif view.used:
            seen[key] = view.name
        result.append(view)
    return result


def _whole_ones(views: list[BoardView], board_wh) -> list[BoardView]:
    """Of a bent board only a whole view tells which of its corners are seen."""
    result = []
    for view in views:
        if view.used and view.corners_wh is not None and view.corners_wh != board_wh:
            reason = f"only {_wh(view.corners_wh)} in view; a bent board must be seen whole"
            view = replace(view, used=False, reason=reason)
        result.append(view)
    return result


def _check_enough(views: list[BoardView], board_wh) -> None:
    used = [view for view in views if view.used]
    if used and not any(view.corners_wh == board_wh for view in used):
        largest = max((view.corners_wh for view in used if view.corners_wh), key=lambda wh: wh[0] * wh[1])
        raise LanelibError(
            f"calibrate: need a whole board of {_wh(board_wh)} inner corners in at least one picture, "
            f"found at most {_wh(largest)}; is that the size of the board?"
        )
    if len(used) < MIN_BOARDS:
        why = next((f" ({view.name}: {view.reason})" for view in views if not view.used), "")
        raise LanelibError(
            f"calibrate: need at least {MIN_BOARDS} pictures of a board of {_wh(board_wh)} inner corners, "
            f"found {len(used)} in {len(views)} pictures{why}; add pictures or check the size of the board"
        )


def _join(*reasons: str) -> str:
    return "; ".join(reason for reason in reasons if reason)


def _wh(wh: tuple[int, int]) -> str:
    return f"{wh[0]}x{wh[1]}"
