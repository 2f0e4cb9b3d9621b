"""``urdf``: make a robot file from a URDF."""

from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import RobotError
from hri_predict.robots.urdf.convert import convert, copied_stopping, decelerated, write


def urdf(
    *,
    source: Annotated[
        Path,
        typer.Argument(metavar="URDF", help="The URDF file. Expand a xacro file first."),
    ],
    base: Annotated[str, typer.Option(metavar="LINK", help="Link fixed in the room.")],
    tip: Annotated[str, typer.Option(metavar="LINK", help="Link at the end of the chain.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The robot file to write.")],
    name: Annotated[
        str | None, typer.Option(help="Name of the robot.", show_default="the URDF's")
    ] = None,
    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LINK", help="Leave out this link and all links after it. Repeatable."
        ),
    ] = None,
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            help="Folder that contains package NAME of package://NAME URLs. Repeatable.",
        ),
    ] = None,
    margin_mm: Annotated[
        float, typer.Option(metavar="MM", help="Margin added to each capsule's radius.")
    ] = 5.0,
    stopping_from: Annotated[
        str | None,
        typer.Option(metavar="ROBOT", help="Copy the stopping table of this robot file."),
    ] = None,
    deceleration: Annotated[
        float | None,
        typer.Option(
            metavar="M/S2", help="Alternatively: the deceleration that the robot always reaches."
        ),
    ] = None,
    brake_delay: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time at full speed before the brakes take effect."),
    ] = None,
    payload_kg: Annotated[
        float | None,
        typer.Option(metavar="KG", help="Heaviest payload for which the deceleration is valid."),
    ] = None,
) -> None:
    """Make a robot file from a URDF: joints, capsules around each link, and the stopping table.

    Example: hri-predict urdf arm.urdf --base base_link --tip tool0 --deceleration 3
    --brake-delay 0.05 --payload-kg 5 --out arm.yaml
    """
    if not 0 <= margin_mm <= 1000:
        raise RobotError(f"--margin-mm must be 0 to 1000; got {margin_mm:g}")
    found = convert(
        source,
        base=base,
        tip=tip,
        stopping=_stopping(stopping_from, deceleration, brake_delay, payload_kg),
        name=name,
        left_out=leave_out,
        packages=package_dir,
        margin_m=margin_mm / 1000,
    )
    write(found, out, margin_mm / 1000)
    joints, capsules = len(found.data["joints"]), len(found.data["capsules"])
    print(f"{out}: {joints} joints, {capsules} capsules; review the file before you use it")
    print(f"what it holds: under tool: and payload:, in {found.hand}")
    if found.omitted:
        print(f"not covered: {', '.join(found.omitted)}")
    if found.unread:
        print(f"ignored, from other programs: {', '.join(found.unread)}")


def _stopping(
    copied_from: str | None,
    deceleration: float | None,
    delay_s: float | None,
    payload_kg: float | None,
) -> dict[str, Any]:
    """Return the chosen stopping table: another robot's, or one computed from a deceleration."""
    if copied_from is not None:
        if (deceleration, delay_s, payload_kg) != (None, None, None):
            raise RobotError("give either --stopping-from or --deceleration, not both")
        return copied_stopping(copied_from)
    if deceleration is None or delay_s is None or payload_kg is None:
        raise RobotError(
            "a URDF does not state how the robot stops; give --deceleration M/S2, --brake-delay S "
            "and --payload-kg KG that hold in all cases, or --stopping-from ROBOT"
        )
    return decelerated(deceleration, delay_s, payload_kg)
