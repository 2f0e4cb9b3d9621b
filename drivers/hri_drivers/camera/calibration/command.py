"""Calibrate a camera with a printed chessboard, and find its pose in the room."""

import json
from pathlib import Path
from typing import Annotated

import typer

from hri_drivers.camera.options import need_cv2
from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import JsonOption
from hri_predict.cli.register.points import point_from
from hri_predict.cli.register.write import lines_to_paste

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__)

Columns = Annotated[int, typer.Option(help="Inner corners along the long side.")]
Rows = Annotated[int, typer.Option(help="Inner corners along the short side.")]
Square = Annotated[
    float, typer.Option(help="Side of a square on the printed board, m: measure it.")
]


@app.command("board")
def draw_board(
    out: Annotated[Path, typer.Option(help="The image to print, a .png.")] = Path("board.png"),
    columns: Columns = 9,
    rows: Rows = 6,
    square: Annotated[float, typer.Option(help="Side of a square, m.")] = 0.025,
) -> None:
    """Draw a chessboard to print; the default fits on A4.

    Example: hri-predict camera-calibration board --out board.png
    """
    need_cv2()
    from hri_drivers.camera.calibration.board import Board, write_sheet

    write_sheet(out, Board(columns, rows, square))
    print(
        f"{out}: print it at 100 % scale, glue it to something flat, and measure a square: its "
        f"sides should be {square * 1e3:g} mm long"
    )


@app.command()
def solve(
    *,
    images: Annotated[Path, typer.Option(help="Folder with images of the board.")],
    square: Square,
    out: Annotated[Path, typer.Option(help="Camera file to write.")] = Path("lens.yaml"),
    columns: Columns = 9,
    rows: Rows = 6,
    as_json: JsonOption = False,
) -> None:
    """Find a camera's focal length, centre and distortion from images of the board.

    Take 15 to 30 pictures with the size and zoom used in operation: the board near and far, in the
    middle and at the edges, tilted by 20 to 45 degrees.

    Example: hri-predict camera-calibration solve --images pictures --square 0.025
    """
    need_cv2()
    from hri_drivers.camera.calibration.board import Board
    from hri_drivers.camera.calibration.solving import calibrate, pictures_of
    from hri_drivers.camera.place.camera import refuse_other_file, write_camera

    refuse_other_file(out)
    found = calibrate(pictures_of(images), Board(columns, rows, square))
    write_camera(out, found.camera)
    camera = found.camera
    if as_json:
        print(
            json.dumps(
                {
                    "path": str(out),
                    "error_px": round(found.error_px, 4),
                    "field_of_view_deg": round(camera.field_of_view_deg, 2),
                    "focal_error": round(camera.focal_error, 5),
                    "used": {name: round(error, 4) for name, error in found.used.items()},
                    "left_out": found.left_out,
                }
            )
        )
        return
    for name, error in found.used.items():
        print(f"{name:30}  corners {error:.2f} pixels off")
    for name, why in found.left_out.items():
        print(f"{name:30}  left out: {why}")
    print(
        f"{out}: {len(found.used)} images, corners {found.error_px:.2f} pixels off; horizontal "
        f"field of view {camera.field_of_view_deg:.1f} degrees, focal length known to "
        f"{100 * camera.focal_error:.1f} %; no pose yet: hri-predict camera-calibration pose"
    )


@app.command()
def pose(
    *,
    camera: Annotated[Path, typer.Option(help="Camera file; the pose is written into it.")],
    image: Annotated[Path, typer.Option(help="Image of the board, taken by this camera.")],
    square: Square,
    at: Annotated[str, typer.Option(metavar="X,Y,Z", help="The board's origin in the room, m.")],
    turned: Annotated[
        float,
        typer.Option(
            min=-360,
            max=360,
            help="Direction of the board's x axis, degrees counter-clockwise from the room's.",
        ),
    ] = 0.0,
    upright: Annotated[
        bool,
        typer.Option("--upright", help="The board is upright, its top edge up, instead of flat."),
    ] = False,
    columns: Columns = 9,
    rows: Rows = 6,
    as_json: JsonOption = False,
) -> None:
    """Find the pose of a calibrated camera from one image of the board at a known place.

    Repeat this for each camera while the board stays in place, so that all cameras share one room
    frame. Copy the pose of the (first) camera into the node's configuration.

    Example: hri-predict camera-calibration pose --camera lens.yaml --image board.jpg
    --square 0.025 --at 1.2,0.4,0.8 --turned 90
    """
    need_cv2()
    from hri_drivers.camera.calibration.board import Board
    from hri_drivers.camera.calibration.solving import pose_of, read_gray, room_from_board
    from hri_drivers.camera.place.camera import read_camera, write_camera

    board = Board(columns, rows, square)
    known = room_from_board(point_from(at, 3, "--at"), turned, upright)
    calibrated = read_camera(camera)
    gray = read_gray(image)
    if gray is None:
        raise ConfigError(f"--image {image}: not an image")
    try:
        placed, error_px = pose_of(gray, calibrated, board, known)
    except ConfigError as error:
        raise ConfigError(f"{image}: {error}") from None
    assert placed.pose is not None
    write_camera(camera, placed)
    found = placed.pose.xyz, placed.pose.quaternion_xyzw
    if as_json:
        print(
            json.dumps(
                {
                    "path": str(camera),
                    "error_px": round(error_px, 4),
                    "xyz": found[0],
                    "quaternion_xyzw": found[1],
                }
            )
        )
        return
    print(f"{camera}: the board's corners are {error_px:.2f} pixels off")
    print(lines_to_paste(found))
