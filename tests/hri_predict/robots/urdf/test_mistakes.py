"""Every mistake in a URDF, and every part of it that would not be read, gives one line."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.hri_predict.robots.urdf.small_urdf import CHAIN, CORNERS, STOP, URDF, run, stl


def swap(old: str, new: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return change


def same(text: str) -> str:
    return text


BOMB = '<!DOCTYPE robot [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
LEAK = '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>'
MISTAKES: dict[str, tuple[Callable[[str], str], list[str], str]] = {
    "no stopping": (same, CHAIN, "does not state how the robot stops.*--deceleration"),
    "half of it": (same, [*CHAIN, *STOP[:4]], "does not state how the robot stops"),
    "both": (same, [*CHAIN, *STOP, "--stopping-from", "ur5e"], "not both"),
    "unknown robot": (same, [*CHAIN, "--stopping-from", "ur5f"], "did you mean 'ur5e?'"),
    "no deceleration": (same, [*CHAIN, *STOP, "--deceleration", "0"], "--deceleration must be"),
    "infinite": (same, [*CHAIN, *STOP, "--brake-delay", "inf"], "--brake-delay must be"),
    "nan": (same, [*CHAIN, *STOP, "--payload-kg", "nan"], "--payload-kg must be"),
    "margin": (same, [*CHAIN, *STOP, "--margin-mm", "-1"], "--margin-mm must be"),
    "no number": (same, [*CHAIN, *STOP, "--margin-mm", "x"], "--margin-mm.*(number|float).*--help"),
    "unknown option": (same, [*CHAIN, *STOP, "--nothing"], "No such option.*--help"),
    "no base": (same, STOP, "Missing option.*--base.*--help"),
    "not there": (same, [*CHAIN, *STOP, "--out", "/dev/null/x.yaml"], "cannot be written"),
    "unknown link": (same, ["--base", "plat", "--tip", "camera", *STOP], "did you mean 'plate'"),
    "other way": (same, ["--base", "camera", "--tip", "plate", *STOP], "not attached to 'camera'"),
    "nothing turns": (same, ["--base", "world", "--tip", "plate", *STOP], "0 joints move"),
    "a branch": (same, CHAIN[:4] + STOP, "'slide' moves link 'finger'.*--leave-out finger"),
    "floats": (
        swap('name="slide" type="prismatic"', 'name="slide" type="floating"'),
        ["--base", "plate", "--tip", "finger", *STOP],
        "'slide' is of type 'floating'",
    ),
    "mimic": (
        swap('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="turn"/>'), CHAIN + STOP,
        "'lift' mimics",
    ),
    "slides too fast": (
        swap('upper="0.1" velocity="1"', 'upper="0.1" velocity="21"'),
        ["--base", "plate", "--tip", "finger", *STOP],
        r"'slide': <limit velocity> must be above 0 \(and up to 20\) m/s",
    ),
    "slides too far": (
        swap('upper="0.1" velocity="1"', 'upper="9" velocity="1"'),
        ["--base", "plate", "--tip", "finger", *STOP],
        "'slide': a prismatic joint is in metres: position at most 8 m",
    ),
    "no geometry": (
        swap('<box size="0.4 0.2 0.1"/>', ""), CHAIN + STOP, "'plate': a <collision> must",
    ),
    "no collision": (
        swap('<collision><geometry><box size="0.4 0.2 0.1"/></geometry></collision>', ""),
        CHAIN + STOP, "link 'plate' has no shape",
    ),
    "unknown shape": (
        swap('<sphere radius="0.07"/>', '<cone radius="1"/>'), CHAIN + STOP,
        "'tower': <geometry> has <cone>",
    ),
    "two shapes": (
        swap('<sphere radius="0.07"/>', '<sphere radius="0.07"/><sphere radius="1"/>'),
        CHAIN + STOP, "'tower': a <collision> must have one",
    ),
    "origin far": (swap('xyz="0 0 0.1"', 'xyz="0 0 1e308"'), CHAIN + STOP, "'turn': origin's xyz"),
    "only seen, not how": (
        swap('<link name="top"/>', '<link name="top"><visual/></link>'), CHAIN + STOP,
        "'top': a <visual> must have one",
    ),
    "the chain left out": (same, [*CHAIN, *STOP, "--leave-out", "arm"], "out arm.*needs it"),
    "another unit": (swap("MESH", "inch.dae"), CHAIN + STOP, "inch.dae.*0.0254 m.*in metres"),
    "no velocity": (swap('velocity="1.5"', 'velocity="0"'), CHAIN + STOP, "'turn': <limit vel"),
    "no limits": (
        swap('<limit lower="-2" upper="2" velocity="1" effort="9"/>', ""), CHAIN + STOP, "lift",
    ),
    "limits reversed": (swap('lower="-2"', 'lower="3"'), CHAIN + STOP, "'lift'.*lower, upper"),
    "limit nan": (swap('lower="-2"', 'lower="nan"'), CHAIN + STOP, "lift"),
    "huge axis": (swap('xyz="0 0 2"', 'xyz="0 0 1e308"'), CHAIN + STOP, "not a direction"),
    "no axis": (swap('xyz="0 0 2"', 'xyz="0 0 0"'), CHAIN + STOP, "turn"),
    "axis of words": (swap('xyz="0 0 2"', 'xyz="a b c"'), CHAIN + STOP, "turn"),
    "origin nan": (swap('xyz="0 0 0.1"', 'xyz="0 nan 0"'), CHAIN + STOP, "small.urdf: .*nan"),
    "far away": (swap('xyz="0 0.1 0"', 'xyz="0 1e9 0"'), CHAIN + STOP, "'tower'.*beyond 10 m"),
    "huge": (swap('radius="0.07"', 'radius="1e9"'), CHAIN + STOP, "'tower'.*0.0001 to 10 m"),
    "hollow": (swap('radius="0.07"', 'radius="-1"'), CHAIN + STOP, "'tower': the radius.*got -1"),
    "a point": (swap('radius="0.07"', 'radius="0"'), CHAIN + STOP, "'tower': the radius.*got 0"),
    "no radius": (swap(' radius="0.07"', ""), CHAIN + STOP, "'tower': the radius of a <sphere>"),
    "inside out": (swap('radius="0.06"', 'radius="-0.06"'), CHAIN + STOP, "'tower': the radius"),
    "upside down": (swap('length="0.4"', 'length="-0.4"'), CHAIN + STOP, "'tower': the length"),
    "a disc": (swap('length="0.4"', 'length="0"'), CHAIN + STOP, "'tower': the length of a <cyl"),
    "length nan": (swap('length="0.4"', 'length="nan"'), CHAIN + STOP, "'tower': the length.*nan"),
    "box inside out": (swap("0.4 0.2 0.1", "0.4 -0.2 0.1"), CHAIN + STOP, "'plate': the size.*-0"),
    "a flat box": (swap("0.4 0.2 0.1", "0.4 0.2 0"), CHAIN + STOP, "'plate': the size of a <box>"),
    "box nan": (swap("0.4 0.2 0.1", "0.4 0.2 nan"), CHAIN + STOP, "'plate': the size of a <box>"),
    "mesh gone": (swap("MESH", "gone.stl"), CHAIN + STOP, "'arm': mesh 'gone.stl' is not there"),
    "package gone": (swap("MESH", "package://p/a.stl"), CHAIN + STOP, "--package-dir.*'p'"),
    "from the net": (swap("MESH", "http://x.org/a.stl"), CHAIN + STOP, "nothing is fetched"),
    "a drawing": (swap("MESH", "arm.step"), CHAIN + STOP, "only .stl, .obj, .dae are read"),
    "broken mesh": (swap("MESH", "broken.stl"), CHAIN + STOP, "broken.stl"),
    "mesh nan": (swap("MESH", "nan.stl"), CHAIN + STOP, "'arm'.*not a number"),
    "bomb": (lambda _: BOMB, CHAIN + STOP, "DOCTYPE"),
    "leak": (lambda _: LEAK, CHAIN + STOP, "DOCTYPE"),
    "cut short": (lambda text: text[:900], CHAIN + STOP, "not valid XML"),
    "empty": (lambda _: "", CHAIN + STOP, "not valid XML"),
    "another": (lambda _: "<html/>", CHAIN + STOP, "outermost element is <html>.*xacro"),
    "no links": (lambda _: "<robot name='a'/>", CHAIN + STOP, "0 links"),
    "nameless": (swap('<link name="top"/>', "<link/>"), CHAIN + STOP, "has no name"),
    "nameless joint": (swap('<joint name="lift"', "<joint"), CHAIN + STOP, "has no name"),
    "unknown parent": (
        swap('<parent link="arm"/>', '<parent link="arn"/>'), CHAIN + STOP, "did you mean 'arm'"
    ),
    "two parents": (
        swap('<child link="finger"/>', '<child link="top"/>'), CHAIN + STOP, "'top' is the child of"
    ),
    "same link": (swap('<link name="top"/>', '<link name="arm"/>'), CHAIN + STOP, "two <link> "),
    "same joint": (swap('name="lift"', 'name="turn"'), CHAIN + STOP, "two <joint> named 'turn'"),
    "long mesh": (swap("MESH", "x" * 5000 + ".stl"), CHAIN + STOP, "is not there"),
    "deep": (
        swap('<sphere radius="0.07"/>', "<a>" * 100_000 + "</a>" * 100_000), CHAIN + STOP,
        "<geometry> has <a>",
    ),
    "a loop": (swap('<parent link="plate"/>', '<parent link="arm"/>'), CHAIN + STOP, "loop"),
    "xacro left in": (
        swap("</robot>", '<x:include xmlns:x="http://www.ros.org/wiki/xacro"/></robot>'),
        CHAIN + STOP, "<xacro:include> is left in it; expand it first",
    ),
    "xacro in a link": (
        swap('<link name="top"/>',
             '<link name="top"><x:if xmlns:x="http://ros.org/wiki/xacro" value="1"/></link>'),
        CHAIN + STOP, "<xacro:if> is left in it; expand it first",
    ),
    "xacro without a namespace": (
        swap("</robot>", '<xacro:arm prefix=""/></robot>'), CHAIN + STOP, "XML.*; expand it first",
    ),
    "placeholder in a name": (
        swap('<link name="top"/>', '<link name="${prefix}top"/>'), CHAIN + STOP,
        r"'\$\{prefix\}top' in <link> is a placeholder.*expand it first",
    ),
    "placeholder in a file": (swap("MESH", "$(find x)/a.stl"), CHAIN + STOP, "is a placeholder"),
    "placeholder in a number": (swap('radius="0.07"', 'radius="${r}"'), CHAIN + STOP, "placehold"),
    "another template": (swap('name="small"', 'name="{{ name }}"'), CHAIN + STOP, "placeholder"),
    "misspelt part": (
        swap('<link name="top"/>', '<lnk name="extra"/><link name="top"/>'), CHAIN + STOP,
        "<robot> has <lnk>.*did you mean 'link'",
    ),
    "misspelt collision": (
        swap('<link name="top"/>', '<link name="top"><colision/></link>'), CHAIN + STOP,
        "link 'top': <link> has <colision>.*did you mean 'collision'",
    ),
    "misspelt limit": (
        swap('lower="-2"', 'low="-2"'), CHAIN + STOP,
        "joint 'lift': <limit> has the attribute 'low'.*did you mean 'lower'",
    ),
    "turned by something else": (
        swap('xyz="0 0 0.1"', 'xyz="0 0 0.1" quat_xyzw="0 0 1 0"'), CHAIN + STOP, "'quat_xyzw'",
    ),
    "a value as text": (
        swap('<link name="top"/>', '<link name="top">0.1</link>'), CHAIN + STOP, "text in <link>",
    ),
    "two origins": (
        swap('<axis xyz="0 1 0"/>', '<origin xyz="0 0 1"/><axis xyz="0 1 0"/>'), CHAIN + STOP,
        "'lift': <joint> has two <origin>",
    ),
    "mesh of scale 0": (swap('"0.5 1 1"', '"0 0 0"'), CHAIN + STOP, "'arm': a mesh's scale 0"),
    "mesh with one scale": (swap('"0.5 1 1"', '"0.5"'), CHAIN + STOP, "scale '0.5' has 1 numb"),
    "mesh of another unit": (swap('"0.5 1 1"', '"1000 1 1"'), CHAIN + STOP, "scale 1000"),
    "mesh in millimetres": (swap("MESH", "mm.stl"), CHAIN + STOP, "'arm'.*metres are meant: 0."),
    "mesh scaled away": (swap('"0.5 1 1"', '"0.0001 0.0001 0.0001"'), CHAIN + STOP, "'arm'.*small"),
    "mesh without points": (swap("MESH", "none.stl"), CHAIN + STOP, "none.stl|'arm'"),
    "box of two sides": (swap("0.4 0.2 0.1", "0.4 0.2"), CHAIN + STOP, "'plate'.*2 numbers, not 3"),
    "origin of two numbers": (swap('"0 0 0.1"', '"0 0.1"'), CHAIN + STOP, "'turn'.*2 numbers"),
    "number of Python": (swap('"0 0 0.1"', '"0 0 0_1"'), CHAIN + STOP, "0_1 is not a finite"),
    "decimal comma": (swap('"0 0 0.1"', '"0 0 0,1"'), CHAIN + STOP, "0,1 is not a finite"),
    "origin in millimetres": (
        swap('xyz="0 0 0.1"', 'xyz="0 0 100"'), CHAIN + STOP, "'turn'.*metres are meant: 0.1?",
    ),
    "box in millimetres": (
        swap("0.4 0.2 0.1", "400 200 100"), CHAIN + STOP, "'plate'.*metres are meant: 0.4?",
    ),
    "turned in degrees": (
        swap('rpy="0 0 0.7"', 'rpy="0 0 40"'), CHAIN + STOP, "'lift'.*radians are meant: 0.698",
    ),
    "limits in degrees": (
        swap('lower="-2" upper="2"', 'lower="-170" upper="170"'), CHAIN + STOP,
        "'lift': its limit -170.*radians are meant: -2.967?",
    ),
    "velocity in degrees": (
        swap('upper="2" velocity="1"', 'upper="2" velocity="180"'), CHAIN + STOP,
        "'lift'.*radians per second are meant: 3.142?",
    ),
    "slow velocity in degrees": (
        swap('upper="2.5" velocity="1.5"', 'upper="2.5" velocity="30"'), CHAIN + STOP,
        "'turn': velocity 30.*radians per second are meant: 0.5236?",
    ),
    "a base that moves": (
        same, ["--base", "wrist", "--tip", "finger", *STOP],
        "joint 'roll' moves 'wrist': start above it, with --base arm, or make the joint fixed",
    ),
    "a rail below the base": (
        swap('name="floor" type="fixed"', 'name="floor" type="prismatic"'), CHAIN + STOP,
        "joint 'floor' moves 'plate': start above it, with --base world",
    ),
    "too many shapes": (
        swap("</robot>", "".join(
            f'<link name="l{i}"><collision><geometry><sphere radius="0.01"/></geometry></collision>'
            f'</link><joint name="j{i}" type="fixed"><parent link="arm"/><child link="l{i}"/>'
            "</joint>"
            for i in range(60)
        ) + "</robot>"), CHAIN + STOP,
        "65 links have a shape, but a robot has at most 62 capsules; --leave-out",
    ),
    "long name": (swap('name="small"', f'name="{"x" * 80}"'), CHAIN + STOP, "name: .*64"),
}  # fmt: skip


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes_give_one_line(urdf: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    spoil, arguments, message = MISTAKES[case]
    folder = urdf.parent
    (folder / "broken.stl").write_bytes(stl(CORNERS)[:120])
    (folder / "inch.dae").write_text('<COLLADA><asset><unit name="inch" meter="0.0254"/>')
    (folder / "mm.stl").write_bytes(stl(CORNERS * 1000))
    (folder / "none.stl").write_bytes(stl(CORNERS[:0]))
    (folder / "nan.stl").write_bytes(stl(CORNERS * np.nan))
    urdf.write_text(spoil(URDF).replace("MESH", "arm.stl"))
    assert run(urdf, *arguments) == 2
    said = capfd.readouterr()
    assert re.search(message, said.err), said.err
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert not (folder / "mine.yaml").exists()
