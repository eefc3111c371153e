"""`sysid calibrate`: a camera's file from a picture or a video of the table."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.console import DONE, FOUND, Progress, Verb, check_outputs, table, write_json
from models.errors import BadInput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sysid.vision.camera.board import Lens
    from sysid.vision.camera.calibrate import Calibration

    Picture = NDArray[np.uint8]

PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm"}
FRAMES = 15  # of which the median is taken
BOARD_FRAMES = 40  # that are searched for a board
GRID = 0.25  # of the lines drawn on the report [m]
LEGIBLE = 1000  # least width of the report [pixels]


def register(verb: Verb) -> None:
    """The verb with its options."""
    one = verb("calibrate", run, "lens and place of the camera, from the table itself or from a board")
    one.add_argument("input", metavar="VIDEO", help="video, picture, or folder of pictures of the table")
    one.add_argument("--length", type=float, required=True, metavar="L", help="of the table, nose to nose [m]")
    one.add_argument("--width", type=float, required=True, metavar="W", help="of the table, nose to nose [m]")
    one.add_argument("--diameter", type=float, required=True, metavar="D", help="of the balls [m]")
    one.add_argument("--out", required=True, metavar="CAM.toml", help="where the camera goes")
    one.add_argument("--no-pockets", action="store_true", help="the table has none")
    one.add_argument(
        "--fov", type=float, metavar="DEG", help="field of view across the picture's longer side, if known"
    )
    one.add_argument("--board", metavar="9x6", help="take the lens from a chessboard with so many inner corners")
    one.add_argument("--square", type=float, metavar="S", help="side of its squares [m]")
    one.add_argument("--lens", metavar="VIDEO", help="where the board was filmed (default: VIDEO)")
    text = "where the nose lines cross [pixels], if they are not found; with three sides in view four points along them"
    one.add_argument("--corners", metavar='"u,v u,v u,v u,v"', help=text)
    one.add_argument(
        "--sees", default="+x,-x,+y,-y", metavar="SIDES", help="cushions in view, such as +x,+y,-y; begin with a +"
    )
    one.add_argument("--report", metavar="CAM.png", help="the picture with lines, edge points and a grid drawn in")
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON")


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Calibrate, write, tell: 0 done, 1 if the result is not to be trusted."""
    import cv2
    import numpy as np

    from models.shot import Table
    from sysid.vision.camera.calibrate import CameraHints, calibrate
    from sysid.vision.camera.projection import write_camera

    cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
    check_outputs(args.out, args.report, args.json)
    sees, corners, pattern = _checked(args)
    lens, notes = None, []
    if pattern is not None:
        lens = _lens(args, pattern, progress)
        views = f"{lens.views} views" if lens.views > 1 else "the one view"
        notes.append(f"lens from {views} of the board in {args.lens or args.input}, corners to {lens.rms:.2f} pixels")
    progress("reading")
    stack = np.stack(list(frames(args.input, FRAMES)))
    picture = np.median(stack, axis=0) if len(stack) > 1 else stack[0]
    found = calibrate(
        picture, Table(args.length, args.width, not args.no_pockets), args.diameter,
        CameraHints(args.fov, lens, corners, sees), source=str(args.input), progress=progress,
    )  # fmt: skip
    progress.close()
    write_camera(args.out, found.camera)
    print(table(rows(found), right=2))
    for line in (*notes, *found.notes):
        print(line)
    for line in found.doubts:
        print(f"NOT to be trusted: {line}")
    if args.report:
        write_report(args.report, np.rint(picture).astype(np.uint8), found)
        print(f"report: {args.report}")
    if args.json:
        write_json(args.json, to_json(found))
    print(f"camera: {args.out}")
    return FOUND if found.doubts else DONE


def _checked(args: argparse.Namespace) -> tuple[list[str], NDArray[np.float64] | None, tuple[int, int] | None]:
    """The sides seen, the corners given, and the board's pattern; BadInput where an argument makes no sense."""
    import numpy as np

    from models.shot import RAILS

    for name, low, high in (("length", 0.3, 6.0), ("width", 0.2, 3.0), ("diameter", 0.015, 0.12), ("fov", 3.0, 150.0)):
        value = getattr(args, name)
        if value is not None and not low <= value <= high:
            unit = "degrees" if name == "fov" else "metres"
            raise BadInput(f"--{name} {value:g}: is not between {low:g} and {high:g} {unit}")
    if args.length < args.width:
        raise BadInput(f"--length {args.length:g} is less than --width {args.width:g}: exchange them")
    sees = [side.strip() for side in args.sees.split(",")]
    if len(sees) < 3 or len(set(sees)) < len(sees) or not set(sees) <= set(RAILS):
        raise BadInput(f"--sees {args.sees}: name three or four of {', '.join(RAILS)}, joined by commas")
    corners = None
    if args.corners is not None:
        try:
            corners = np.array([[float(v) for v in pair.split(",")] for pair in args.corners.split()])
        except ValueError:
            corners = np.zeros(0)
        if corners.shape != (4, 2) or not np.isfinite(corners).all():
            raise BadInput(f'--corners "{args.corners}": give four points as "u,v u,v u,v u,v", in pixels')
    if args.board is None:
        if args.square is not None or args.lens is not None:
            raise BadInput("--square and --lens belong to a board: give --board, such as 9x6")
        return sees, corners, None
    counts = args.board.lower().split("x")
    if len(counts) != 2 or not all(c.isdigit() and 3 <= int(c) <= 50 for c in counts):
        raise BadInput(f"--board {args.board}: give its inner corners along and across, such as 9x6")
    if args.square is None or not 0.002 <= args.square <= 0.5:
        raise BadInput(f"--square {args.square}: give the side of the board's squares in metres, such as 0.03")
    if args.fov is not None:
        raise BadInput("--fov and --board both tell the focal length: give one of them")
    return sees, corners, (int(counts[0]), int(counts[1]))


def _lens(args: argparse.Namespace, pattern: tuple[int, int], progress: Progress) -> Lens:
    """The lens from the board, wherever it was filmed."""
    from sysid.vision.camera.board import lens_of

    return lens_of(frames(args.lens or args.input, BOARD_FRAMES), pattern, args.square, progress)


def frames(path: str, most: int) -> Iterator[Picture]:
    """Up to so many pictures, spread over a video or a folder, or the one that a file holds: (height, width, 3)."""
    import cv2
    import numpy as np

    place = Path(path)
    if not place.exists():
        raise BadInput(f"{path}: does not exist; name a video, a picture, or a folder of pictures")
    if place.is_dir() or place.suffix.lower() in PICTURES:
        files = sorted(f for f in place.iterdir() if f.suffix.lower() in PICTURES) if place.is_dir() else [place]
        if not files:
            raise BadInput(f"{path}: holds no pictures ({', '.join(sorted(PICTURES))}); name a video or a picture")
        shape: tuple[int, ...] | None = None
        for k in np.unique(np.linspace(0, len(files) - 1, min(most, len(files))).astype(int)):
            picture = cv2.imread(str(files[k]), cv2.IMREAD_COLOR)
            if picture is None:
                raise BadInput(f"{files[k]}: is not a picture that can be read; take it away or convert it to PNG")
            if shape not in (None, picture.shape):
                raise BadInput(f"{files[k]}: is of another size than those before it; take it away")
            shape = picture.shape
            yield picture
        return
    video = cv2.VideoCapture(path)
    try:
        count = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
        yielded = False
        for k in np.unique(np.linspace(0, max(count - 1, 0), most).astype(int)):
            if k > 0:
                video.set(cv2.CAP_PROP_POS_FRAMES, int(k))
            good, picture = video.read()
            if good:
                yielded = True
                yield picture
        if not yielded:
            raise BadInput(f"{path}: is not a video that can be read; convert it, to H.264 in mp4 for instance")
    finally:
        video.release()


def rows(found: Calibration) -> list[tuple[str, str]]:
    """What is printed."""
    camera, sides = found.camera, found.rails
    worst = max(sides, key=lambda rail: sides[rail])
    lost = 100 * (1 - found.lines.kept.mean())
    sure = f" +- {100 * found.focal_sd:.2g} %" if math.isfinite(found.focal_sd) else ""
    points = f"{found.lines.kept.sum()} on {len(sides)} sides, {lost:.0f} % set aside" if found.edges else "none"
    known = f"sd {1e3 * found.spread[0]:.2f} mm rms, {1e3 * found.spread[1]:.2f} mm at worst" if found.edges else "-"
    k1_sd = found.lines.sd.get("k1", math.nan)
    k1 = f"{camera.distortion[0]:.4f}" + (f" +- {k1_sd:.4f}" if math.isfinite(k1_sd) else "")
    k2 = f", k2 {camera.distortion[1]:.4f}" if camera.distortion[1] else ""
    return [
        ("residual", f"{1e3 * camera.residual_m:.2f} mm rms, worst side {worst} {1e3 * sides[worst]:.2f} mm"),
        ("edge points", points),
        ("edge taken", found.edge),
        ("focal length", f"{camera.matrix[0, 0]:.0f} pixels{sure}, {found.fov:.1f} degrees across, {found.focal_from}"),
        ("height", f"{camera.eye[2]:.3f} m over the cloth"),
        ("tilt", f"{found.tilt:.2f} degrees"),
        ("distortion", f"k1 {k1}{k2}"),
        ("places of balls", known),
        (
            "focal length 10 % off",
            f"{1e3 * found.parallax[0]:.2f} mm rms, {1e3 * found.parallax[1]:.2f} mm at worst, places of balls",
        ),
    ]


def to_json(found: Calibration) -> dict[str, Any]:
    """The same figures, SI units."""
    camera = found.camera
    return {
        "format": "billiard-calibration/1", "residual_m": camera.residual_m, "sides_m": found.rails,
        "edge_points": int(found.lines.kept.sum()) if found.edges else 0,
        "set_aside": float(1 - found.lines.kept.mean()) if found.edges else math.nan,
        "edge": found.edge, "focal_px": camera.matrix[0, 0], "focal_from": found.focal_from,
        "focal_sd": found.focal_sd, "fov_deg": found.fov, "height_m": camera.eye[2], "tilt_deg": found.tilt,
        "distortion": camera.distortion.tolist(), "k1_sd": found.lines.sd.get("k1", math.nan),
        "place_sd_m": {"rms": found.spread[0], "worst": found.spread[1]},
        "focal_10_percent_off_m": {"rms": found.parallax[0], "worst": found.parallax[1]},
        "source": camera.source, "notes": list(found.notes), "doubts": list(found.doubts),
    }  # fmt: skip


def write_report(path: str, picture: Picture, found: Calibration) -> None:
    """The picture with the nose lines, the edge points by their residual, and a grid on the plane of the balls."""
    import cv2
    import numpy as np

    from models.files import write_whole
    from sysid.vision.camera.table_edges import nose_points

    camera, canvas = found.camera, picture.copy()
    half = np.array([camera.table.length, camera.table.width]) / 2
    thick = max(1, round(picture.shape[1] / 1000))

    def draw(points: NDArray[np.float64], colour: tuple[int, int, int], width: int) -> None:
        # What lies far outside the picture may be folded back into it by the distortion.
        near = np.abs(camera.on_plane(camera.project(points), float(points[0, 2])) - points[:, :2]).max(axis=1) < 1e-3
        pixels = np.rint(16 * camera.project(points[near])).astype(np.int32)
        cv2.polylines(canvas, [pixels], False, colour, width, cv2.LINE_AA, 4)

    for axis in (0, 1):
        for k in range(-int(half[axis] / GRID), int(half[axis] / GRID) + 1):
            line = np.full((60, 3), camera.radius)
            line[:, axis], line[:, 1 - axis] = k * GRID, np.linspace(-1, 1, 60) * half[1 - axis]
            draw(line, (235, 235, 235) if k else (255, 255, 0), thick)
    for rail in sorted(set(found.lines.rails.tolist())):
        along = np.linspace(-1, 1, 200) * half[1 - rail // 2]
        draw(nose_points(camera, rail, along, np.zeros(200)), (255, 0, 255), thick)
    unit = max(camera.residual_m, 1e-6)
    for (u, v), away, kept in zip(found.lines.pixels, found.lines.away, found.lines.kept, strict=True):
        far = min(abs(away) / (3 * unit), 1.0)
        colour = (0, int(255 * (1 - far)), int(255 * far)) if kept else (160, 160, 160)
        cv2.circle(canvas, (round(16 * u), round(16 * v)), 16 * (thick + 1), colour, cv2.FILLED, cv2.LINE_AA, 4)
    larger = max(1, -(-LEGIBLE // canvas.shape[1]))
    canvas = cv2.resize(canvas, None, fx=larger, fy=larger, interpolation=cv2.INTER_NEAREST)
    scale = canvas.shape[1] / 1600
    texts = [f"{name}: {text}" for name, text in rows(found)] + [f"NOT to be trusted: {t}" for t in found.doubts]
    below = np.zeros((int((14 + 24 * len(texts)) * scale), canvas.shape[1], 3), np.uint8)
    for k, text in enumerate(texts):
        place = (int(12 * scale), int((26 + 24 * k) * scale))
        cv2.putText(below, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, (255, 255, 255), 1, cv2.LINE_AA)
    canvas = np.vstack([canvas, below])
    write_whole(path, cv2.imencode(".png", canvas)[1].tobytes())
