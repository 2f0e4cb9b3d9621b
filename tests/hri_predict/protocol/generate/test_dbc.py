"""The shipped DBC files, read by cantools in a process of its own, agree with the codec."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from cantools.database import Database

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.definition import BY_TYPE, DEFINITIONS, frame_table, needed_parts
from hri_predict.protocol.fields import MAX_ROBOTS
from hri_predict.protocol.generate.dbc import FILES, dbc_text, frame_name
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    BaseMotion,
    Level,
    Message,
    NodeState,
    OperatingMode,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason

DBC = Path(__file__).resolve().parents[4] / "drivers" / "dbc"

# Knows nothing of the project: decodes "id hex" lines with cantools alone, answers in JSON lines.
DECODER = """
import json, sys, cantools
database = cantools.database.load_file(sys.argv[1])
for line in sys.stdin:
    frame_id, data = line.split()
    message = database.get_message_by_frame_id(int(frame_id))
    named = message.decode(bytes.fromhex(data), decode_choices=True)
    plain = message.decode(bytes.fromhex(data), decode_choices=False)
    row = {k: str(v) if not isinstance(v, (int, float)) else plain[k] for k, v in named.items()}
    print(json.dumps([message.name, row]))
"""


def load_shipped(fd: bool) -> Database:
    database = cantools.database.load_file(DBC / FILES[fd])
    assert isinstance(database, Database)
    return database


def decode_elsewhere(fd: bool, frames: list) -> list[tuple[str, dict]]:
    text = "".join(f"{f.arbitration_id} {f.data.hex()}\n" for f in frames)
    done = subprocess.run(
        [sys.executable, "-c", DECODER, str(DBC / FILES[fd])],
        input=text,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


def some(rng: np.random.Generator, low: float, high: float) -> float | None:
    return None if rng.random() < 0.15 else float(rng.uniform(low, high))


def index(rng: np.random.Generator, end: int) -> int | None:
    return None if rng.random() < 0.15 else int(rng.integers(end))


def base(rng: np.random.Generator) -> BaseMotion:
    x, y, vx, vy, rate = rng.uniform(-32.7, 32.7, 5).tolist()
    yaw = float(rng.uniform(-3.14, 3.14))
    return BaseMotion(x_m=x, y_m=y, yaw_rad=yaw, vx_m_s=vx, vy_m_s=vy, yaw_rate_rad_s=rate)


def random_message(rng: np.random.Generator, kind: type) -> Message:
    """A message with every field drawn from its whole range."""
    if kind is Advice:
        return Advice(
            robot=int(rng.integers(MAX_ROBOTS)),
            level=Level(int(rng.integers(6))),
            reason=Reason(int(rng.choice(list(Reason)))),
            latch_id=int(rng.integers(65536)),
            separation_m=some(rng, -32.7, 32.7),
            predicted_separation_m=some(rng, -32.7, 32.7),
            time_to_breach_s=some(rng, 0, 4.09),
            speed_limit_m_s=some(rng, 0, 65.5),
            body_part=index(rng, 63),
            robot_link=index(rng, 63),
            echo=index(rng, 65535),
            age_s=some(rng, 0, 65.5),
            mode=OperatingMode(int(rng.integers(4))),
            tool=index(rng, 255),
        )
    if kind is Status:
        return Status(
            node_state=NodeState(int(rng.integers(6))),
            reason=Reason(int(rng.choice(list(Reason)))),
            people=int(rng.integers(15)),
            predictor=int(rng.integers(256)),
            cycle=int(rng.integers(256)),
            age_s=some(rng, 0, 65.5),
        )
    if kind is RobotState:
        joints, moving = int(rng.integers(10)), rng.random() < 0.3
        return RobotState(
            robot=int(rng.integers(4 if moving else MAX_ROBOTS)),
            mode=RobotMode(int(rng.integers(5))),
            counter=int(rng.integers(65536)),
            positions=tuple(rng.uniform(-8.1, 8.1, joints).tolist()),
            velocities=tuple(rng.uniform(-20.4, 20.4, joints).tolist()),
            request=OperatingMode(int(rng.integers(4))),
            enabling=bool(rng.integers(2)),
            tool=index(rng, 255),
            tool_confirmed=bool(rng.integers(2)),
            base=base(rng) if moving else None,
        )
    if kind is Acknowledge:
        return Acknowledge(int(rng.integers(65536)), int(rng.integers(1 << 32)))
    if kind is Schema:
        return Schema(int(rng.integers(65536)), int(rng.integers(1 << 32)))
    person, step = int(rng.integers(65536)), int(rng.integers(256))
    horizon_s = float(rng.uniform(0, 65.5))
    if kind is Zone:
        capsules = tuple(
            ZoneCapsule(i, tuple(p[:3]), tuple(p[3:]), float(rng.uniform(0, 65.5)))
            for i, p in enumerate(rng.uniform(-32.7, 32.7, (int(rng.integers(1, 18)), 6)).tolist())
        )
        return Zone(
            person=person,
            step=step,
            horizon_s=horizon_s,
            capsules=capsules,
            age_s=some(rng, 0, 65.5),
        )
    joints_xyz = rng.uniform(-32.7, 32.7, (int(rng.integers(1, 22)), 3)).tolist()
    return Pose(
        person=person,
        step=step,
        horizon_s=horizon_s,
        joints=tuple((i, *p) for i, p in enumerate(joints_xyz)),
        age_s=some(rng, 0, 65.5),
    )


def expected(message: Message) -> dict[str, object]:
    """Signal -> value, written out by hand so as not to share the codec's order of fields."""
    match message:
        case Advice():
            return {
                "LEVEL": message.level.name,
                "REASON": message.reason.name,
                "LATCH_ID": message.latch_id,
                "SEPARATION": message.separation_m,
                "PREDICTED_SEPARATION": message.predicted_separation_m,
                "TIME_TO_BREACH": message.time_to_breach_s,
                "SPEED_LIMIT": message.speed_limit_m_s,
                "BODY_PART": message.body_part,
                "ROBOT_LINK": message.robot_link,
                "ECHO": message.echo,
                "AGE": message.age_s,
                "OPERATING_MODE": message.mode.name,
                "TOOL": message.tool,
            }
        case Status():
            return {
                "NODE_STATE": message.node_state.name,
                "REASON": message.reason.name,
                "PEOPLE": message.people,
                "PREDICTOR": message.predictor,
                "CYCLE": message.cycle,
                "AGE": message.age_s,
            }
        case RobotState():
            row: dict[str, object] = {
                "MODE": message.mode.name,
                "JOINTS": len(message.positions),
                "STATE_COUNTER": message.counter,
                "REQUEST": message.request.name,
                "TOOL": message.tool,
                "ENABLING": int(message.enabling),
                "TOOL_CONFIRMED": int(message.tool_confirmed),
                "BASE": int(message.base is not None),
            }
            for i in range(max(6, len(message.positions))):
                inside = i < len(message.positions)
                row[f"POSITION_{i + 1}"] = message.positions[i] if inside else None
                row[f"VELOCITY_{i + 1}"] = message.velocities[i] if inside else None
            if message.base is not None:
                row["BASE_X"], row["BASE_Y"] = message.base.x_m, message.base.y_m
                row["BASE_VX"], row["BASE_VY"] = message.base.vx_m_s, message.base.vy_m_s
                row["BASE_YAW"] = message.base.yaw_rad
                row["BASE_YAW_RATE"] = message.base.yaw_rate_rad_s
            return row
        case Acknowledge():
            return {"LATCH_ID": message.latch_id, "ACK_ID": message.ack_id}
        case Schema():
            return {"SCHEMA_VERSION": message.version, "SCHEMA_HASH": message.hash}
    return {
        "PERSON": message.person,
        "STEP": message.step,
        "HORIZON": message.horizon_s,
        "AGE": message.age_s,
    }


RESOLUTION = {f.signal: f.resolution for d in DEFINITIONS for f in (*d.fields, *d.item)}


def assert_same(signal: str, got: object, want: object, resolution: float) -> None:
    if want is None:
        assert got == "NOT_AVAILABLE", signal
    elif isinstance(want, float):
        assert got == pytest.approx(want, abs=1.01 * resolution), signal
    else:
        assert got == want, signal


@pytest.mark.parametrize("fd", [False, True])
def test_cantools_in_another_process_reads_what_was_sent(fd: bool) -> None:
    rng = np.random.default_rng(20 + fd)
    sender = CanSender(fd)
    kinds = [d.type for d in DEFINITIONS if fd or d.classic]
    sent = [random_message(rng, kind) for kind in kinds for _ in range(60)]
    frames = [(message, sender.encode(message)) for message in sent]
    decoded = iter(decode_elsewhere(fd, [f for _, group in frames for f in group]))
    for message, group in frames:
        definition = BY_TYPE[type(message)]
        rows = [next(decoded) for _ in group]
        got = {signal: value for _, row in rows for signal, value in row.items()}
        robot = getattr(message, "robot", 0)
        head = group[0].data[2:]
        parts = [0] * len(group) if fd else sorted(needed_parts(definition, head))
        names = [frame_name(definition, robot, part, fd) for part in parts]
        assert [name for name, _ in rows] == names
        for signal, want in expected(message).items():
            assert_same(signal, got[signal], want, RESOLUTION[signal])
        if isinstance(message, Zone):
            assert_same_zone(message, [row for _, row in rows])
        if isinstance(message, Pose):
            assert_same_pose(message, [row for _, row in rows])


def assert_same_zone(zone: Zone, rows: list[dict]) -> None:
    for i, capsule in enumerate(zone.capsules):
        row, k = rows[i // 3], i % 3
        assert row["FIRST"] + k == i
        assert row["TOTAL"] == len(zone.capsules)
        assert row[f"SEGMENT_{k}"] == capsule.segment
        for end, point in (("A", capsule.a), ("B", capsule.b)):
            got = [row[f"{end}_{axis}_{k}"] for axis in "XYZ"]
            assert got == pytest.approx(list(point), abs=0.00051)
        assert 0 <= row[f"RADIUS_{k}"] - capsule.radius + 1e-8 <= 0.0011


def assert_same_pose(pose: Pose, rows: list[dict]) -> None:
    for i, (joint, *point) in enumerate(pose.joints):
        row, k = rows[i // 7], i % 7
        assert row[f"JOINT_{k}"] == joint
        assert [row[f"{axis}_{k}"] for axis in "XYZ"] == pytest.approx(point, abs=0.00051)


@pytest.mark.parametrize(("base_id", "extended"), [(0x100, False), (0x18FF0000, True)])
def test_a_file_for_another_base_id_decodes_what_is_sent_there(
    base_id: int, extended: bool
) -> None:
    database: Any = cantools.database.load_string(dbc_text(False, base_id, extended))
    message = Status(
        node_state=NodeState.RUNNING, reason=Reason.NONE, people=3, predictor=4, cycle=5, age_s=0.25
    )
    (frame,) = CanSender(False, base_id, extended).encode(message)
    found = database.get_message_by_frame_id(frame.arbitration_id)
    assert found.is_extended_frame is extended
    assert (found.name, found.decode(frame.data)["AGE"]) == ("STATUS", 0.25)
    assert found.comment == load_shipped(False).get_message_by_name("STATUS").comment


def test_a_base_id_from_which_not_all_ids_fit_is_refused() -> None:
    with pytest.raises(ConfigError, match="0x7a0"):
        dbc_text(False, 0x7A1)


@pytest.mark.parametrize("fd", [False, True])
def test_dbc_manners(fd: bool) -> None:
    database = load_shipped(fd)
    assert len(database.messages) == len(frame_table(classic=not fd))
    for message in database.messages:
        assert message.comment
        assert message.is_fd is fd
        names = [signal.name for signal in message.signals]
        assert {"COUNTER", "CHECKSUM"} <= set(names)
        assert all(name == name.upper() for name in names)
        assert all(signal.comment for signal in message.signals)
    advice = database.get_message_by_name("ADVICE_R0" if fd else "ADVICE_R0_P0")
    assert advice.cycle_time == 40
    for signal, enum in (("LEVEL", Level), ("REASON", Reason)):
        named = advice.get_signal_by_name(signal).choices
        assert named is not None
        assert {int(k): str(v) for k, v in named.items()} == {e.value: e.name for e in enum}
